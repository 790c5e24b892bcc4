"""Golden files: what the program answered before a change of the code, to be compared with what it answers after."""
