"""Contracts for each kind of plug-in, as checks that its author can run: `ltvn plugins test NAME`."""
