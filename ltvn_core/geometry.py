"""SE(2) in closed form: compose, invert, relate, and the paper's distance. Pure numpy, batched over leading axes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose, Waypoint


def wrap_angle(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Wrap angles into (-pi, pi]."""
    return np.pi - np.mod(np.pi - np.asarray(angle_rad, np.float64), 2 * np.pi)


def compose(pose: Pose, waypoint: Waypoint) -> Pose:
    """Return the pose reached from `pose` (..., 3) by `waypoint` (..., 3) given in its frame."""
    pose, waypoint = np.asarray(pose, np.float64), np.asarray(waypoint, np.float64)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack(
        [
            pose[..., 0] + cos * waypoint[..., 0] - sin * waypoint[..., 1],
            pose[..., 1] + sin * waypoint[..., 0] + cos * waypoint[..., 1],
            wrap_angle(pose[..., 2] + waypoint[..., 2]),
        ],
        axis=-1,
    )


def invert(waypoint: Waypoint) -> Waypoint:
    """Return the source in the frame of the target, (..., 3)."""
    waypoint = np.asarray(waypoint, np.float64)
    cos, sin = np.cos(waypoint[..., 2]), np.sin(waypoint[..., 2])
    return np.stack(
        [
            -cos * waypoint[..., 0] - sin * waypoint[..., 1],
            sin * waypoint[..., 0] - cos * waypoint[..., 1],
            wrap_angle(-waypoint[..., 2]),
        ],
        axis=-1,
    )


def relative(source: Pose, target: Pose) -> Waypoint:
    """Return `target` (..., 3) in the frame of `source` (..., 3)."""
    return compose(invert(source), target)


def distance(waypoint: Waypoint) -> NDArray[np.float64]:
    """Return d(w) = ||log T(w)||_F, Eq. 2, for waypoints (..., 3).

    In closed form sqrt(2 theta^2 + |rho|^2) with |rho| = |t| (theta/2) / sin(theta/2): a metre straight ahead is 1,
    a turn on the spot by a radian is sqrt(2).
    """
    waypoint = np.asarray(waypoint, np.float64)
    theta = wrap_angle(waypoint[..., 2])
    stretch = 1 / np.sinc(theta / (2 * np.pi))  # (theta/2) / sin(theta/2), 1 at zero.
    rho = np.hypot(waypoint[..., 0], waypoint[..., 1]) * stretch
    return np.sqrt(2 * theta**2 + rho**2)


def rotation(yaw_rad: float) -> NDArray[np.float64]:
    """Return the (2, 2) rotation matrix of a yaw."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin], [sin, cos]])
