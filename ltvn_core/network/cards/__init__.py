"""Model cards, which are stored beside weights: their training data, settings and metrics."""
