"""Maps with their images, and maps of several drives."""
