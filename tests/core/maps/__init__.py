"""Several drives in one map."""
