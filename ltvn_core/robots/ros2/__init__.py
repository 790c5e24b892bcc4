"""Robots of ROS 2, spoken to without ROS: as `rmw_zenoh` does, by Zenoh and CDR."""
