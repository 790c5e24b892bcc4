"""Image pairs for training: sampling of poses, labels of reachability, and their files.

Uses numpy only. The simulator is accessed through the Protocols of `ltvn_core.network.training_data.pose_sampling`.
"""
