"""Metrics of a network: pairs, drives, calibration and speed."""
