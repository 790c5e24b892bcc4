"""How well filters of presence foretell when things are there, on recorded sequences with truth."""
