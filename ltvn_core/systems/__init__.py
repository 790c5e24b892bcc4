"""The navigation systems that can be compared: the paper's own and its baselines, each with one module and one
entry."""
