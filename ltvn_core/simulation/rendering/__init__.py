"""RGB-D rendering: ray casting, shading, textures and the choice of a renderer."""
