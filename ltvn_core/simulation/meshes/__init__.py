"""Scenes from mesh files, such as scans and Gibson spaces."""
