"""The verbs of the command line, one module per job. Composition happens here; the parts know nothing of each other.

Heavy libraries are imported inside `run`, so that `ltvn --help` answers at once and so that a verb works on a machine
that lacks what it does not need (PyBullet for a replay, for instance).
"""
