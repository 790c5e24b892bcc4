"""Simulation: scenes, physics, robot, camera and ground truth. The only home of pybullet."""
