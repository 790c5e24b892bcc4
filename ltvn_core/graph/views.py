"""What the nodes look like: images and features by frame, encoded once each.

Owns observations and features for every frame that is a node or in the reserve.
"""
