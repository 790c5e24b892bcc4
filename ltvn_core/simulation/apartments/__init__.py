"""Procedural apartments, grown from a seed."""
