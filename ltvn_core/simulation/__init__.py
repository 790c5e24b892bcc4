"""Simulation: scenes, bodies, robot, renderers and the ground truth. No other package imports pybullet."""
