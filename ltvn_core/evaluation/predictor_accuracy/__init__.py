"""Accuracy of a predictor on a recording with true poses: pairs of images, maps, and localisation."""
