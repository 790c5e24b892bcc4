"""Databases of RTAB-Map, which is a SLAM program that keeps all its images in one sqlite file."""
