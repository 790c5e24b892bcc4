"""Image pairs for training: where to look from, what counts as reachable, and how it is kept on disk.

Numpy only. The simulator comes in through the Protocols of `ltvn_core.training_data.scene_protocols`.
"""
