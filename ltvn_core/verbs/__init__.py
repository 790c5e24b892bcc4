"""The verbs of the command line, one module of options each; `jobs` has what they do, a module each.

Modules of options import nothing heavy, so that `ltvn --help` answers at once. Modules of jobs import plainly, and
`Verb.run` imports the one that is needed, so that a verb works on a machine that lacks what it does not need (PyBullet
for a replay, for instance). Composition happens in the jobs; the parts know nothing of each other.
"""
