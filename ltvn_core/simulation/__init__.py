"""Simulation: scenes, bodies, robot, renderer and the ground truth. No other package imports pybullet."""
