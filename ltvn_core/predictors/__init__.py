"""Predictors, which compare two images: opening by name, the choice of a default, and the toolkit's own ones."""
