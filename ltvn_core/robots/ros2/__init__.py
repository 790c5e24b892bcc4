"""Robots of ROS 2, without an installation of ROS: messages in CDR over Zenoh, compatible with `rmw_zenoh`."""
