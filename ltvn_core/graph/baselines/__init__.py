"""Systems to compare the paper's with, in the same navigator."""
