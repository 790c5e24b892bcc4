"""Numbers of a drive that comes in: how far it goes, what hangs together, how odometry drifts, where time is lost.

Owns the arithmetic on poses and stamps, and no words about it; those are `drive_doubts`'.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ltvn_core.geometry import compose, relative, wrap_angle
from ltvn_core.importing.stamp_matching import period_s
from ltvn_core.types import Pose, Tilt

NEAR_M = 0.6
NEAR_RAD = math.radians(20)
"""Two images that are nearer than both can be compared; a map has edges between such."""

GAP_PERIODS = 5.0
GAP_S = 1.0
"""A pause between two images is a gap when it is longer than both."""
_REVISIT_PATH_M = 3.0
_REVISIT_S = 10.0
"""A place is come back to after so long a way, or, turning on the spot, after so long a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """How far odometry strays from the true poses."""

    position_rmse_m: float
    """Of the whole drive, laid over the truth as well as possible."""
    per_metre: float
    """Median error over stretches of a metre or so, as a share of the way."""
    yaw_deg_per_metre: float
    """The same of the heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRange:
    """How a camera was tilted over a drive, in degrees; upwards and right side down are positive."""

    pitch_median_deg: float
    pitch_lowest_deg: float
    pitch_highest_deg: float
    roll_largest_deg: float
    """95 % of the images are rolled by less, to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """What a map of the drive would be like if every pair of images that are near could be joined."""

    pieces: int
    """Parts that no chain of near images joins."""
    largest_share: float
    """Share of the images in the largest of them."""
    revisited_share: float
    """Share of the images that show a place where the drive had been before."""


def path_m(poses: Pose) -> float:
    """Return the length of a way through poses (N, 3)."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()) if len(poses) > 1 else 0.0


def coverage(poses: Pose, stamps: NDArray[np.float64]) -> Coverage:
    """Return what a map of N images with these poses (N, 3) and stamps (N,) would be like."""
    pairs = _near_pairs(poses)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(poses), len(poses)))
    pieces, labels = connected_components(graph, directed=False)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) if len(poses) > 1 else np.zeros(0)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    first, last = pairs.min(axis=1), pairs.max(axis=1)
    again = (way[last] - way[first] >= _REVISIT_PATH_M) | (stamps[last] - stamps[first] >= _REVISIT_S)
    return Coverage(
        pieces=int(pieces),
        largest_share=float(np.bincount(labels).max() / len(poses)),
        revisited_share=len(np.unique(last[again])) / len(poses),
    )


def _near_pairs(poses: Pose) -> NDArray[np.intp]:
    """Return the places (K, 2) of poses that are near each other."""
    # Headings lie on a circle on which the chord of NEAR_RAD is as long as NEAR_M.
    radius = NEAR_M / (2 * math.sin(NEAR_RAD / 2))
    points = np.column_stack([poses[:, :2], radius * np.cos(poses[:, 2]), radius * np.sin(poses[:, 2])])
    pairs = KDTree(points).query_pairs(NEAR_M * math.sqrt(2), output_type="ndarray")
    apart = poses[pairs[:, 1]] - poses[pairs[:, 0]]
    near = (np.hypot(apart[:, 0], apart[:, 1]) < NEAR_M) & (np.abs(wrap_angle(apart[:, 2])) < NEAR_RAD)
    return pairs[near]


def drift(odometry: Pose, truth: Pose) -> Drift | None:
    """Compare odometry with truth, both (N, 3); None where the drive is too short to say."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    ends = np.searchsorted(way, way + 1.0)
    starts = np.flatnonzero(ends < len(way))
    if not len(starts):
        return None
    ends = ends[starts]
    gap = relative(relative(truth[starts], truth[ends]), relative(odometry[starts], odometry[ends]))
    stretch_m = way[ends] - way[starts]
    return Drift(
        position_rmse_m=_aligned_rmse_m(odometry, truth),
        per_metre=float(np.median(np.hypot(gap[:, 0], gap[:, 1]) / stretch_m)),
        yaw_deg_per_metre=float(np.degrees(np.median(np.abs(gap[:, 2]) / stretch_m))),
    )


def _aligned_rmse_m(odometry: Pose, truth: Pose) -> float:
    """Return the root mean square distance after the best rigid alignment in the plane (Umeyama, 1991)."""
    from_middle, to_middle = odometry[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    left, right = odometry[:, :2] - from_middle, truth[:, :2] - to_middle
    cross = (left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0]).sum()
    turn = np.array([0.0, 0.0, math.atan2(cross, float((left * right).sum()))])
    turned = compose(turn, np.column_stack([left, np.zeros(len(left))]))[:, :2]
    return float(np.sqrt(((turned - right) ** 2).sum(axis=1).mean()))


def tilt_range(tilts: Sequence[Tilt]) -> TiltRange | None:
    """Return how the camera was tilted; None without any tilt."""
    if not tilts:
        return None
    pitch, roll = np.degrees(np.array(tilts)).T
    return TiltRange(
        pitch_median_deg=float(np.median(pitch)),
        pitch_lowest_deg=float(pitch.min()),
        pitch_highest_deg=float(pitch.max()),
        roll_largest_deg=float(np.percentile(np.abs(roll), 95)),
    )


def gaps_s(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths in seconds of the pauses between N images in order that are longer than usual."""
    pauses = np.diff(stamps)
    return pauses[pauses > max(GAP_S, GAP_PERIODS * (period_s(stamps) or 0.0))]
