"""Predictors that need no trained network."""
