"""The neural network and its training. No other package imports torch."""
