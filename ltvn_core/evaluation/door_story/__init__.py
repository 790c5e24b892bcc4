"""A demonstration of learning in a map: a door on the planned way closes, and later opens again."""
