"""Damaged recordings. `integrity` is the door: it checks a recording, and gives back what is whole of a damaged one."""
