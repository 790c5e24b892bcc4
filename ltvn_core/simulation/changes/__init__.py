"""A world that changes: carries changes out in a scene, by hand or by a script over time."""
