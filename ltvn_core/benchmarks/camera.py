"""How fast the camera is on a large mesh, against PyBullet's own renderer."""
