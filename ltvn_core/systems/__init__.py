"""The navigation systems that can be compared: the paper's own and its baselines, one row each."""
