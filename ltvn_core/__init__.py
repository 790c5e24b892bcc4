"""Navigation on a map of images that learns from every drive. Knows no browser."""
