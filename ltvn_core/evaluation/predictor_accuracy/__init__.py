"""How good a predictor is on a recording with true poses: pairs of images, the map, and finding one's place."""
