"""A changing world: applies changes to a scene, by hand or by a script over time."""
