"""From a camera's pose in space to what the toolkit keeps of it: a pose in the plane, a tilt and a height.

Owns the conventions of frames: the optical frame (x right, y down, z forward) and the body frame (x forward, y left,
z up), in a world whose z is up.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose, Tilt

BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3): takes right, down, forward to forward, left, up."""

_WORST_PITCH = np.radians(89.0)
"""A camera that looks straight up or down has no heading; its tilt is given as this."""


class SpatialPose(NamedTuple):
    """Where a camera is and how it is turned, in a world whose z is up."""

    planar: Pose
    """(3,): x, y, and the heading of its optical axis."""
    tilt: Tilt
    """Its pitch and roll, as `CameraModel` has them."""
    height_m: float
    """Its z."""


def spatial_pose(position: ArrayLike, rotation: ArrayLike) -> SpatialPose:
    """Return a pose in space as pose in the plane, tilt and height.

    Args:
        position: (3,) metres in the world.
        rotation: (3, 3): takes directions of the camera's *optical* frame to the world. For a body frame such as
            `base_link`, hand in `rotation @ BODY_FROM_OPTICAL`.
    """
    x, y, z = np.asarray(position, np.float64)
    body: NDArray[np.float64] = np.asarray(rotation, np.float64) @ BODY_FROM_OPTICAL.T
    forward = body[:, 0]
    left = body[:, 1]
    up = body[:, 2]
    pitch = np.clip(np.arcsin(np.clip(forward[2], -1.0, 1.0)), -_WORST_PITCH, _WORST_PITCH)
    return SpatialPose(
        planar=np.array([x, y, np.arctan2(forward[1], forward[0])]),
        tilt=Tilt(pitch_rad=float(pitch), roll_rad=float(np.arctan2(left[2], up[2]))),
        height_m=float(z),
    )
