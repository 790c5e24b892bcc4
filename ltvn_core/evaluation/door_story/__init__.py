"""A demonstration of learning in a map: a door on the planned path closes, and later opens again."""
