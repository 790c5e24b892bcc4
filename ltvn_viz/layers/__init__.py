"""The 3D parts of the page, one class each.

Every layer owns scene nodes of fixed names, changes them in place, and sends only what changed since the last snapshot.
"""

COURSE_Z, TRAJECTORY_Z, NODE_Z, EDGE_Z, CHANGE_Z, PLAN_Z = 0.01, 0.02, 0.035, 0.06, 0.09, 0.12
"""Heights in metres, so that what matters more lies on top when seen from above."""
