"""Maps with their images, and several drives in one map."""
