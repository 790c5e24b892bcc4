"""RGB-D rendering: ray casting, texture table, shading."""
