"""Navigation: drives a robot to goals by a topological map."""
