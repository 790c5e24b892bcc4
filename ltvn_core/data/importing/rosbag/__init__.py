"""Bags of ROS 2 (MCAP and sqlite3) and of ROS 1, read with the library `rosbags`."""
