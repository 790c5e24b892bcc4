"""A story that shows what a map learns: a door on the planned way closes, later it opens again."""
