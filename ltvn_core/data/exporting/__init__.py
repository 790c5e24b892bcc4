"""Exporting: recordings and maps in the formats of other programs. One module a format."""
