"""The verbs of the command line, one module each: options, job and summary.

A module imports no large library before its verb runs, so that `ltvn --help` answers at once, and so that a verb works
on a machine without the libraries of the others (a replay does not need PyBullet, for instance).
"""
