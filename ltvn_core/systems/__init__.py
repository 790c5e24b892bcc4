"""The navigation systems that can be compared, the paper's own and its baselines: a file and a registry line each."""
