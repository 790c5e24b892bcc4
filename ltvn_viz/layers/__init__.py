"""The 3D parts of the page, one class each.

Every layer owns scene nodes with fixed names, updates them in place, and sends only the changes since the last
snapshot.
"""

TRAJECTORY_Z, EDGE_Z, CHANGE_Z, PLAN_Z, NODE_Z = 0.02, 0.06, 0.09, 0.12, 0.14
"""Heights of the layers in metres; when seen from above, a more important layer covers the others."""
