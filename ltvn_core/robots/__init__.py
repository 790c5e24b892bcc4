"""Robots: their interface (`robot.Robot`), their properties (`robot_spec.RobotSpec`), and the lease that stops them."""
