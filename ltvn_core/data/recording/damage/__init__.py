"""Damaged recordings. `integrity` is the entry point: it checks a recording, and recovers the undamaged data of a
damaged one."""
