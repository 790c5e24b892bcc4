"""Driving by the map."""
