"""What goes wrong with a robot's camera: each a small function of an observation, with a strength in physical units."""
