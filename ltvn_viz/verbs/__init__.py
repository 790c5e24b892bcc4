"""The verbs of the command line that open pages."""
