"""Scenes from mesh files that other people made, Gibson folders among them."""
