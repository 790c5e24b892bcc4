"""Databases of RTAB-Map, a SLAM program that keeps all its images in one sqlite file."""
