"""Poses of frames, and the floor around them, for drawing the map in space.

The exact pose is used if there is one (in simulation, so that nodes lie on the floor of the drawn scene); otherwise the
odometry is used. For drawing only.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.deltas import Node
from ltvn_core.structured_text import parse_json
from ltvn_core.types import FrameId, Pose

_GLB_MAGIC = b"glTF"
_HEADER_BYTES = 20
"""Size in bytes of the header of a binary glTF, with length and type of its first chunk, which is JSON."""


@dataclass(frozen=True, slots=True)
class FloorExtent:
    """A rectangle on the floor, in metres."""

    low: tuple[float, float]
    """Smallest x and y."""
    high: tuple[float, float]
    """Largest x and y."""
    top_m: float = 0.0
    """Height of the walls around the rectangle, in metres."""

    @classmethod
    def of_points(cls, points: NDArray[np.floating]) -> Self | None:
        """Return the rectangle around points (N, 3) of x, y and height, or None when there are none."""
        finite = points[np.isfinite(points).all(axis=1)]
        if len(finite) == 0:
            return None
        (left, bottom, _), (right, top, height) = finite.min(axis=0).tolist(), finite.max(axis=0).tolist()
        return cls((left, bottom), (right, top), max(height, 0.0))

    @classmethod
    def of_glb(cls, glb: bytes) -> Self | None:
        """Return the rectangle around all vertices of a binary glTF, z up; None if the file does not give their
        limits."""
        if glb[:4] != _GLB_MAGIC or len(glb) < _HEADER_BYTES:
            return None
        (length,) = struct.unpack_from("<I", glb, 12)
        try:
            content = parse_json(glb[_HEADER_BYTES : _HEADER_BYTES + length])
            used = {part["attributes"]["POSITION"] for mesh in content["meshes"] for part in mesh["primitives"]}
            corners = [content["accessors"][k][end] for k in used for end in ("min", "max")]
            return cls.of_points(np.array(corners, float).reshape(-1, 3))
        except (ValueError, KeyError, IndexError, TypeError):
            return None  # The scene is drawn anyway.

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the rectangle: x and y in metres."""
        return (self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2

    @property
    def width_m(self) -> float:
        """Extent along x in metres."""
        return self.high[0] - self.low[0]

    @property
    def height_m(self) -> float:
        """Extent along y in metres."""
        return self.high[1] - self.low[1]


class DrawnPoses:
    """Remembers the drawn pose of every frame and node that was written."""

    def __init__(self) -> None:
        self._poses: dict[FrameId, tuple[float, float, float]] = {}

    def add_frame(self, frame: FrameId, drawn_pose: Pose) -> None:
        """Remember a frame."""
        x, y, yaw = drawn_pose
        self._poses[frame] = (float(x), float(y), float(yaw))

    def add_node(self, node: Node) -> None:
        """Remember the odometry pose of a node whose frame was never written."""
        self._poses.setdefault(node.id, (node.odometry.x_m, node.odometry.y_m, node.odometry.yaw_rad))

    @property
    def extent(self) -> FloorExtent | None:
        """The floor around all remembered poses."""
        places = np.array([*self._poses.values()], np.float64).reshape(-1, 3)
        return FloorExtent.of_points(places * (1, 1, 0))

    def pose(self, frame: FrameId | None) -> Pose | None:
        """Return the drawn pose (3,) of a frame; None if it is unknown."""
        pose = self._poses.get(frame) if frame is not None else None
        return None if pose is None else np.array(pose)

    def points(self, frames: Sequence[FrameId], height_m: float) -> NDArray[np.float32]:
        """Return the positions (N, 3) of the known frames, at a height above the floor."""
        known = [self._poses[frame] for frame in frames if frame in self._poses]
        points = np.array(known, np.float32).reshape(-1, 3)
        points[:, 2] = height_m
        return points
