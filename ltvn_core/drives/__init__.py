"""Several drives in one map: images numbered on, odometry kept apart, and what changed from one drive to the next."""
