"""Procedural apartments, generated from a seed."""
