"""Image pairs for training: sampling of poses, labels of reachability, and their files.

Numpy only. The simulator comes in through the Protocols of `ltvn_core.network.training_data.pose_sampling`.
"""
