"""Evaluates navigation systems in simulation, where the ground truth is known."""
