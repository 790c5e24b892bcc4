"""Simulation: scenes, physics, robot, renderers and the ground truth. No other package imports pybullet."""
