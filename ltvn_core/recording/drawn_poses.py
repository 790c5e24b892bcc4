"""Where frames were taken, so that a graph of pictures can be drawn in space. For drawing only.

The exact pose wins where there is one (in simulation, so that nodes lie on the floor of the drawn scene); otherwise
odometry does.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.deltas import Node
from ltvn_core.recording.floor_extent import FloorExtent
from ltvn_core.types import FrameId, Pose


class DrawnPoses:
    """Remembers the drawn pose of every frame and node that was written."""

    def __init__(self) -> None:
        self._poses: dict[FrameId, tuple[float, float, float]] = {}

    def add_frame(self, frame: FrameId, drawn_pose: Pose) -> None:
        """Remember a frame."""
        x, y, yaw = drawn_pose
        self._poses[frame] = (float(x), float(y), float(yaw))

    def add_node(self, node: Node) -> None:
        """Remember a node whose frame was never written, by its odometry."""
        self._poses.setdefault(node.id, (node.odometry.x_m, node.odometry.y_m, node.odometry.yaw_rad))

    @property
    def extent(self) -> FloorExtent | None:
        """The floor around everything that is remembered."""
        places = np.array([*self._poses.values()], np.float64).reshape(-1, 3)
        return FloorExtent.of_points(places * (1, 1, 0))

    def pose(self, frame: FrameId | None) -> Pose | None:
        """Return the drawn pose (3,) of a frame, or None when it was never seen."""
        pose = self._poses.get(frame) if frame is not None else None
        return None if pose is None else np.array(pose)

    def points(self, frames: Sequence[FrameId], height_m: float) -> NDArray[np.float32]:
        """Return the places (N, 3) of the frames that are known, at a height above the floor."""
        known = [self._poses[frame] for frame in frames if frame in self._poses]
        points = np.array(known, np.float32).reshape(-1, 3)
        points[:, 2] = height_m
        return points
