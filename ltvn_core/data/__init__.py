"""Image pairs and their labels for training."""
