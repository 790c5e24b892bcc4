"""Exporting: recordings and maps in the formats of other programs. Each format has a module of its own."""
