"""Cameras: projection, mounting, rectification, and reading of colour and depth images."""
