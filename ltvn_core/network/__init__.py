"""The network and its training. The only home of torch."""
