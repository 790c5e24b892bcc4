"""Robots: what the toolkit needs of one (`robot.Robot`), what kind it is (`robot_spec.RobotSpec`), and how it stops."""
