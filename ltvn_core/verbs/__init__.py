"""The verbs of the command line. Each module here holds the options of a verb; the modules in `jobs` do the work.

Option modules import no large library, so that `ltvn --help` answers at once. `Verb.run` imports only the job module of
the verb, so that a verb works on a machine without the libraries of the others (a replay does not need PyBullet, for
instance). The job modules combine the parts of the toolkit, which do not depend on each other.
"""
