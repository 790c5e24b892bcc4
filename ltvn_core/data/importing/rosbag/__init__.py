"""ROS bags: ROS 2 (MCAP and sqlite3) and ROS 1, read with the library `rosbags`."""
