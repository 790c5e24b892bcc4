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

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, distance, relative
from ltvn_core.graph.bridges import REACH
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.graph.revisits import near_pairs, revisits
from ltvn_core.importing.stamp_matching import period_s
from ltvn_core.types import Pose, Tilt

GAP_PERIODS = 5.0
GAP_S = 1.0
"""A pause between two images is a gap when it is longer than both."""


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
    """What a map of the drive would be like at best: all near images joined, and by odometry those in a row."""

    pieces: int
    """Parts that no chain of such images joins."""
    largest_share: float
    """Share of the images in the largest of them."""
    revisited_share: float
    """Share of the images that show a place where the drive had been before."""


def path_m(poses: Pose) -> float:
    """Return the length of a way through poses (N, 3)."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()) if len(poses) > 1 else 0.0


def coverage(poses: Pose, stamps: NDArray[np.float64]) -> Coverage:
    """Return what a map of N images with these poses (N, 3) and stamps (N,) would be like."""
    near = near_pairs(poses)
    joined = np.concatenate([near, _bridged_pairs(poses, stamps)])
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(poses), len(poses)))
    pieces, labels = connected_components(graph, directed=False)
    return Coverage(
        pieces=int(pieces),
        largest_share=float(np.bincount(labels).max() / len(poses)),
        revisited_share=len(np.unique(revisits(near, poses, stamps)[:, 1])) / len(poses),
    )


def _bridged_pairs(poses: Pose, stamps: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows (K, 2) of images that odometry alone may join in a map, because the robot drove between them."""
    breaks = np.hypot(*np.diff(poses[:, :2], axis=0).T) > JUMP_M if len(poses) > 1 else np.zeros(0, bool)
    breaks |= np.diff(stamps) > PAUSE_S
    stretch = np.concatenate([[0], np.cumsum(breaks)])
    pairs = [np.empty((0, 2), np.intp)]
    for gap in range(1, min(REACH, len(poses) - 1) + 1):
        apart = distance(relative(poses[:-gap], poses[gap:]))
        rows = np.flatnonzero((apart < ROBUST.building.connect_distance) & (stretch[:-gap] == stretch[gap:]))
        pairs.append(np.column_stack([rows, rows + gap]))
    return np.concatenate(pairs)


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
