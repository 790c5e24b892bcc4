"""Where a frame was in another over time, between the moments at which somebody said so.

Owns interpolation of poses in space and the limits of what may be guessed. Poses are (4, 4) matrices.
"""

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

Transform = NDArray[np.float64]
"""(4, 4): takes points of a child frame to its parent frame."""

_LONGEST_GAP_S = 0.5
"""Between two poses farther apart nobody knows where the robot was, unless it stood still,"""
_STANDING_M = 0.03
_STANDING_RAD = np.radians(2.0)
"""which is what so little motion means."""
_LATEST_S = 0.1
"""So long before the first pose and behind the last it counts as where the robot was."""
_KEPT = 4096
"""Poses; images wait for their pose, and not the other way round, so older ones are not asked for."""


def transform(translation: ArrayLike, quaternion: ArrayLike) -> Transform | None:
    """Return a pose in space from (3,) metres and (4,) x, y, z, w; None where they are no pose."""
    place = np.asarray(translation, np.float64)
    turn = np.asarray(quaternion, np.float64)
    if not (np.all(np.isfinite(place)) and np.all(np.isfinite(turn))) or np.linalg.norm(turn) < 1e-6:
        return None
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(turn / np.linalg.norm(turn)).as_matrix()
    result[:3, 3] = place
    return result


def inverse(pose: Transform) -> Transform:
    """Return where the parent is in the child."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def are_rotations(turns: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
    """Tell (...) which matrices (..., 3, 3) of finite numbers turn without mirroring or stretching."""
    errors = np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3)).max(axis=(-2, -1))
    return np.asarray((errors < tolerance) & (np.linalg.det(turns) > 0))


def pose_between(positions: NDArray[np.float64], turns: Rotation, share: float) -> Transform:
    """Return the pose between two, on the straight line and by the shortest turn.

    Args:
        positions: (2, 3) metres in the parent frame.
        turns: Two of them, from the child frame to the parent frame.
        share: 0 at the first pose, 1 at the second.
    """
    result = np.eye(4)
    result[:3, :3] = Slerp([0.0, 1.0], turns)(share).as_matrix()
    result[:3, 3] = (1 - share) * positions[0] + share * positions[1]
    return result


class MovingFrame:
    """Poses of a frame in its parent in the order of their stamps; what comes late is left out."""

    def __init__(self) -> None:
        """Begin without any pose."""
        self._stamps: list[float] = []
        self._poses: list[Transform] = []

    @property
    def newest_s(self) -> float:
        """Stamp of the last pose; minus infinity without any."""
        return self._stamps[-1] if self._stamps else float("-inf")

    @property
    def count(self) -> int:
        """How many poses are known."""
        return len(self._stamps)

    @property
    def last(self) -> Transform:
        """The last pose; there must be one."""
        return self._poses[-1]

    def add(self, stamp: float, pose: Transform) -> bool:
        """Take in a pose; False where it is not newer than the last, and thus left out."""
        if stamp <= self.newest_s:
            return False
        self._stamps.append(stamp)
        self._poses.append(pose)
        if len(self._stamps) > 2 * _KEPT:
            del self._stamps[:_KEPT], self._poses[:_KEPT]
        return True

    def at(self, stamp: float) -> Transform | None:
        """Return the pose at a moment; None where the poses do not tell."""
        after = bisect_right(self._stamps, stamp)
        if 0 < after < len(self._stamps):
            return self._between(after, stamp)
        if not self._stamps:
            return None
        nearest = -1 if after else 0
        return self._poses[nearest] if abs(self._stamps[nearest] - stamp) <= _LATEST_S else None

    def _between(self, after: int, stamp: float) -> Transform | None:
        begin = self._stamps[after - 1]
        end = self._stamps[after]
        first = self._poses[after - 1]
        second = self._poses[after]
        turn = Rotation.from_matrix([first[:3, :3], second[:3, :3]])
        if end - begin > _LONGEST_GAP_S and not _stands(first, second, turn):
            return None
        places = np.array([first[:3, 3], second[:3, 3]])
        return pose_between(places, turn, (stamp - begin) / (end - begin))


def _stands(first: Transform, second: Transform, turn: Rotation) -> bool:
    moved = float(np.linalg.norm(second[:3, 3] - first[:3, 3]))
    return moved < _STANDING_M and float((turn[0].inv() * turn[1]).magnitude()) < _STANDING_RAD
