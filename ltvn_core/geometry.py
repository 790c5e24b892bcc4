"""SE(2) in closed form: compose, invert, relate, and the paper's distance. Pure numpy, batched over leading axes."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose, Waypoint


def wrap_angle(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Wrap angles into (-pi, pi]."""
    return _wrapped(np.asarray(angle_rad, np.float64))


def compose(pose: Pose, waypoint: Waypoint) -> Pose:
    """Return the pose that is reached from a pose by a waypoint.

    Args:
        pose: Poses (..., 3): x and y in metres, yaw in radians.
        waypoint: Poses (..., 3) in the frame of `pose`.

    Raises:
        ValueError: The shapes do not fit each other.
    """
    (x, y, yaw), (ahead, left, turn) = _coordinates(pose), _coordinates(waypoint)
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    return _together(x + cos * ahead - sin * left, y + sin * ahead + cos * left, _wrapped(yaw + turn))


def invert(waypoint: Waypoint) -> Waypoint:
    """Return the pose of the source in the frame of the target, (..., 3)."""
    ahead, left, turn = _coordinates(waypoint)
    cos = np.cos(turn)
    sin = np.sin(turn)
    return _together(-cos * ahead - sin * left, sin * ahead - cos * left, _wrapped(-turn))


def relative(source: Pose, target: Pose) -> Waypoint:
    """Return the pose of a target in the frame of a source.

    Args:
        source: Poses (..., 3): x and y in metres, yaw in radians.
        target: Poses (..., 3) in the same frame as `source`.

    Raises:
        ValueError: The shapes do not fit each other.
    """
    return compose(invert(source), target)


def agree(first: Pose, second: Pose, limits: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell (...) whether two poses (..., 3) differ by less than `limits`, in metres and radians."""
    gap = relative(first, second)
    return (np.hypot(gap[..., 0], gap[..., 1]) < limits[0]) & (np.abs(gap[..., 2]) < limits[1])


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


def tilt_distance(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """Return the d between two cameras at the same pose with tilts (..., 2), pitch and roll in radians.

    Looking up by an angle removes as much from view as turning aside by the same angle, so both count equally.
    """
    gap = wrap_angle(np.asarray(second, np.float64) - np.asarray(first, np.float64))
    return np.sqrt(2) * np.linalg.norm(gap, axis=-1)


def rotation(yaw_rad: float) -> NDArray[np.float64]:
    """Return the (2, 2) rotation matrix of a yaw."""
    cos = np.cos(yaw_rad)
    sin = np.sin(yaw_rad)
    return np.array([[cos, -sin], [sin, cos]])


class RigidFit(NamedTuple):
    """Rigid alignment of points with other points."""

    pose: Pose
    """Pose (3,) of the points' frame in the frame of the other points."""
    error_m: float
    """Root mean square distance in metres after the alignment."""


def rigid_fit(points: ArrayLike, onto: ArrayLike) -> RigidFit:
    """Return the rigid motion that fits points (N, 2) to other points (N, 2) by least squares (Umeyama, 1991)."""
    points, onto = np.asarray(points, np.float64), np.asarray(onto, np.float64)
    middle, to_middle = points.mean(axis=0), onto.mean(axis=0)
    left, right = points - middle, onto - to_middle
    cross = (left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0]).sum()
    turn = float(np.arctan2(cross, (left * right).sum()))
    apart = left @ rotation(turn).T - right
    pose = np.array([*(to_middle - rotation(turn) @ middle), turn])
    return RigidFit(pose, float(np.sqrt((apart**2).sum(axis=1).mean())))


def lengths_along(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length (M,) along a path (M, 2) from its start to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])


def points_along(path: NDArray[np.float64], marks_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (N, 2) of a path (M, 2) at lengths (N,) from its start, limited to the ends of the path."""
    lengths_m = lengths_along(path)
    return np.column_stack([np.interp(marks_m, lengths_m, path[:, axis]) for axis in (0, 1)])


def _coordinates(pose: Pose) -> Any:
    """Return x, y and yaw: arrays (...), or floats for a single pose, with which Python is several times as fast."""
    pose = np.asarray(pose, np.float64)
    return pose.tolist() if pose.ndim == 1 else (pose[..., 0], pose[..., 1], pose[..., 2])


def _together(x: Any, y: Any, yaw: Any) -> Pose:
    """Return poses (..., 3) from coordinates (...)."""
    return np.stack([x, y, yaw], axis=-1) if np.ndim(x) else np.array([x, y, yaw], np.float64)


def _wrapped(angle_rad: Any) -> Any:
    return np.pi - (np.pi - angle_rad) % (2 * np.pi)
