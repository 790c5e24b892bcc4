"""Predictors, which compare two images: opening one by name, the default, and the toolkit's own predictors."""
