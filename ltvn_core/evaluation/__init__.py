"""Measures the method in simulation, where the truth is known."""
