"""Presence: when an edge is open, by filters over observations of obstacles."""
