"""The map and the pure operations on it."""
