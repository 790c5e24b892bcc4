"""Wheel slips: jumps of odometry without motion of the robot, found where two consecutive depth images contradict it.

After a slip everything that odometry placed earlier is displaced: obstacles, the waypoint, the path. The two images
mostly show the same things, so the motion between them can be measured: among motions near the odometry's, the one that
aligns the two scans best (correlative scan matching, Olson 2009). Wheels slip along the heading and in the heading, so
these two are searched first. Where odometry agrees with the images it is not changed (ours). The search itself errs, on
a hand-held camera by decimetres. So a slip in a recorded drive must be larger than the usual error of the search in
that drive, and is then searched sideways too, because its pictures confirm it (`SlipCheck`) or it is left: depth alone
may be aligned by a motion that never was, as along a plain wall. Owns how a slip is detected and mended. Without depth,
and where odometry never moves, no slip is found.
"""

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_scan import RANGE_M, DepthScan
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.corrections import Correction
from ltvn_core.graph.keyframes import odometry_of
from ltvn_core.graph.matching import Matcher
from ltvn_core.types import FrameId, Observation, Pose

_APART_M, _APART_RAD = 0.4, 0.5
"""Largest motion between two compared images, in m and rad; images taken farther apart show too little in common."""
_LOOK_M, _LOOK_RAD = 0.2, 0.2
"""Largest motion between two images of the tracker, in m and rad."""
_AGREES_M = 0.045
"""Mean distance below which two scans agree with odometry, in metres."""
_BETTER = 0.5
"""Factor by which another motion must reduce that distance."""
_CAP_M = 0.25
"""Distance at which points without a counterpart are capped, in metres."""
_COMPARED_M = 0.65
"""Height in metres below which scans are compared, whatever the robot's height."""
_LEAST_POINTS = 15
_EDGE_RAD, _NEAR_M = 0.1, 0.35
"""Points within this of the edge of the earlier image, in rad, or of its camera, in m, may have no counterpart
there."""
_AHEAD, _LEFT = 0, 1
"""Axes of the robot along which it may be displaced."""
_STEPS = ((0.05, 0.04), (0.0125, 0.01))
"""Step sizes of the search in m and rad: coarse, then fine."""
_REACH = ((9, 9), (4, 4))
"""Number of search steps to each side, in m and rad: coarse, then fine."""
_COST_PER_M, _COST_PER_RAD = 0.02, 0.025
"""Cost of deviating from odometry, so that among equally good motions the nearest to it wins."""
_SURFACE_GAP_M, _SURFACE_STEP_M = 0.8, 0.04
"""Largest gap between neighbouring scan points that belong to one surface, and the spacing of the points added to it,
in metres. Without added points, scan points along a corridor lie far apart, and two scans agree best without any
motion."""
_SAMPLED = 24
"""Number of pairs of images that agree with odometry in which the search is tried too, to learn its error."""
_MEDIAN = 0.6745
"""Median of the sizes of errors, in standard errors."""
_ERRORS = 4.0
"""Size of a slip in standard errors of the search above which it is no error."""
_LEAST_SLIP_M, _LEAST_SLIP_RAD = 0.03, 0.03
"""Size of the smallest slip that is told from an error, in m and rad."""


class Slip(NamedTuple):
    """A jump of odometry between two consecutive images of a drive."""

    row: int
    """Place of the second image in its drive."""
    moved: Pose
    """(3,) motion between the two images by odometry."""
    truly: Pose
    """(3,) motion by their depth."""

    @property
    def size(self) -> NDArray[np.float64]:
        """(2,) size of the jump, in m and rad."""
        off = relative(self.moved, self.truly)
        return np.array([np.hypot(off[0], off[1]), abs(off[2])])


Confirms: TypeAlias = Callable[[Sequence[Observation], Slip, tuple[int, int]], bool]
"""Tells of a drive, one of its slips, and the first and the last image around it without another slip, whether the slip
is mended."""


class _Fit(NamedTuple):
    """The motion that aligns two scans best, and the mean distances of the scans in metres."""

    motion: Pose
    gap_m: float
    gap_by_odometry_m: float

    @property
    def is_better(self) -> bool:
        """Whether odometry contradicts the scans, and the motion fits much better."""
        return self.gap_by_odometry_m > _AGREES_M and self.gap_m < _BETTER * self.gap_by_odometry_m


class SlipTracker:
    """Corrects the odometry of images for slips, one after the other."""

    def __init__(self, camera: CameraModel) -> None:
        """Take images of this camera."""
        self._camera = camera
        self._last: tuple[Observation, DepthScan] | None = None
        self._frame: Pose | None = None
        """(3,) pose of the current odometry frame in the original one; None as long as nothing slipped."""
        self._moves = False
        """Whether odometry ever moved; if not, there is none that a slip could falsify."""

    def see(self, seen: Observation) -> Observation:
        """Return the next image, with corrected odometry."""
        if self._last is None or seen.step != self._last[0].step:
            self._compare(seen)
        return seen if self._frame is None else replace(seen, odometry=self.mended(seen.odometry))

    def mended(self, odometry: Pose) -> Pose:
        """Return odometry (3,) corrected for the slips found so far."""
        return odometry if self._frame is None else compose(self._frame, odometry)

    def needs_image(self, odometry: Pose) -> bool:
        """Tell whether a robot at raw odometry (3,) has moved so far since the last image that it needs another."""
        if self._last is None:
            return False
        moved = relative(self._last[0].odometry, odometry)
        return bool(np.hypot(moved[0], moved[1]) > _LOOK_M or abs(moved[2]) > _LOOK_RAD)

    def _compare(self, seen: Observation) -> None:
        scan = DepthScan.from_image(seen, self._camera, np.zeros(3), height_m=_COMPARED_M)
        last, self._last = self._last, (seen, scan)
        if last is None:
            return
        earlier, before = last
        moved = relative(earlier.odometry, seen.odometry)
        self._moves = self._moves or bool(moved.any())
        if not self._moves or _are_apart(moved):
            return
        fit = _fit(before, scan, moved)
        if fit is not None and fit.is_better:
            # From now on the frame is shifted so that the image lies where the robot truly moved to.
            self._frame = compose(compose(self.mended(earlier.odometry), fit.motion), invert(seen.odometry))


def without_slips(
    observations: Sequence[Observation],
    camera: CameraModel,
    drive_starts: Collection[FrameId] = (),
    confirms: Confirms | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Observation]:
    """Return images in their order, each with odometry corrected for the slips before it in its drive.

    Odometry restarts at `drive_starts`. Without `confirms`, all slips are mended. `progress` is called with the share
    of the images that were searched.
    """
    drives = list[list[Observation]]()
    for seen in observations:
        if not drives or seen.step in drive_starts:
            drives.append([])
        drives[-1].append(seen)
    number = itertools.count(1)

    def searched() -> None:
        progress(next(number) / len(observations))

    return [seen for drive in drives for seen in _mended(drive, find_slips(drive, camera, searched), confirms)]


def _mended(drive: Sequence[Observation], slips: Sequence[Slip], confirms: Confirms | None) -> Sequence[Observation]:
    ends = [0, *(slip.row for slip in slips), len(drive)]
    frame: Pose | None = None
    mended = [*drive[: ends[1]]]
    for k, slip in enumerate(slips):
        if confirms is None or confirms(drive, slip, (ends[k], ends[k + 2] - 1)):
            frame = compose(compose(mended[-1].odometry, slip.truly), invert(drive[slip.row].odometry))
        for seen in drive[slip.row : ends[k + 2]]:
            mended.append(seen if frame is None else replace(seen, odometry=compose(frame, seen.odometry)))
    return mended


def find_slips(
    drive: Sequence[Observation], camera: CameraModel, searched: Callable[[], None] = lambda: None
) -> list[Slip]:
    """Return the slips of a drive, in order: jumps larger than the error of the search for them in this drive.

    `searched` is called for each image that is compared with the one before it.
    """
    if not np.ptp([seen.odometry for seen in drive], axis=0).any():
        return []
    scans = [DepthScan.from_image(seen, camera, np.zeros(3), height_m=_COMPARED_M) for seen in drive]
    moves = {row: relative(drive[row - 1].odometry, drive[row].odometry) for row in range(1, len(drive))}
    moves = {row: move for row, move in moves.items() if drive[row - 1].step != drive[row].step}
    moves = {row: move for row, move in moves.items() if not _are_apart(move)}
    sampled = {[*moves][k] for k in np.linspace(0, len(moves) - 1, min(_SAMPLED, len(moves))).astype(int)}
    fits = dict[int, _Fit | None]()
    for row, move in moves.items():
        fits[row] = _fit(scans[row - 1], scans[row], move, axes=(_AHEAD, _LEFT), always=row in sampled)
        searched()
    found = {row: (Slip(row, moves[row], fit.motion), fit) for row, fit in fits.items() if fit is not None}
    if not found:
        return []
    # The median is the usual error, as long as most of these pairs did not slip.
    usual = np.median([slip.size for slip, _ in found.values()], axis=0)
    least = np.maximum(_ERRORS * usual / _MEDIAN, (_LEAST_SLIP_M, _LEAST_SLIP_RAD))
    return [slip for slip, fit in found.values() if fit.is_better and (slip.size > least).any()]


def _are_apart(moved: Pose) -> bool:
    return bool(np.hypot(moved[0], moved[1]) > _APART_M or abs(moved[2]) > _APART_RAD)


def _fit(
    before: DepthScan, after: DepthScan, moved: Pose, *, axes: tuple[int, ...] = (_AHEAD,), always: bool = False
) -> _Fit | None:
    """Return the best motion near the odometry's (3,); None if the scans share too little, or agree with odometry
    unless it is asked for `always`."""
    surface = _surface(before.solid_points())
    points = after.solid_points()
    if min(len(surface), len(points)) < _LEAST_POINTS:
        return None
    tree = KDTree(surface)
    best = moved
    (at_odometry,) = _gaps(tree, before, points, moved[None])
    if not (0.0 if always else _AGREES_M) < at_odometry < np.inf:
        return None
    for (steps, reach), axis in itertools.product(zip(_STEPS, _REACH, strict=True), axes):
        candidates = _around(best, axis, steps, reach)
        off = np.abs(relative(moved, candidates))
        cost = _gaps(tree, before, points, candidates) + off @ (_COST_PER_M, _COST_PER_M, _COST_PER_RAD)
        best = candidates[int(cost.argmin())]
    (at_best,) = _gaps(tree, before, points, best[None])
    return _Fit(best, float(at_best), float(at_odometry))


def _around(motion: Pose, axis: int, steps: tuple[float, float], reach: tuple[int, int]) -> Pose:
    """Return candidate motions (C, 3) around one (3,), with other distances along an axis of the robot and other
    turns."""
    shift, turn = np.meshgrid(*(step * np.arange(-n, n + 1) for step, n in zip(steps, reach, strict=True)))
    steps_there = np.zeros((shift.size, 3))
    steps_there[:, axis], steps_there[:, 2] = shift.ravel(), turn.ravel()
    return compose(motion, steps_there)


def _gaps(tree: KDTree, before: DepthScan, points: NDArray[np.float64], motions: Pose) -> NDArray[np.float64]:
    """Return (C,) the mean distance of a scan (M, 2) from an earlier one, for each motion (C, 3) between them.

    The distance is infinite if the earlier scan shows too few of the points.
    """
    cos, sin = np.cos(motions[:, 2:]), np.sin(motions[:, 2:])
    x = motions[:, :1] + cos * points[:, 0] - sin * points[:, 1]
    y = motions[:, 1:2] + sin * points[:, 0] + cos * points[:, 1]
    away_m = np.hypot(x, y)
    shown = (np.abs(np.arctan2(y, x)) < before.half_rad - _EDGE_RAD) & (away_m > _NEAR_M) & (away_m < RANGE_M - _CAP_M)
    gaps = np.full(x.shape, _CAP_M)
    gaps[shown] = tree.query(np.stack([x[shown], y[shown]], axis=-1), distance_upper_bound=_CAP_M)[0]
    count = shown.sum(axis=1)
    total = np.where(shown, np.minimum(gaps, _CAP_M), 0.0).sum(axis=1)
    return np.where(count < _LEAST_POINTS, np.inf, total / np.maximum(count, 1))


def _surface(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (K, 2) of a scan, with points added between neighbours that belong to one surface."""
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    near = np.flatnonzero(gaps < _SURFACE_GAP_M)
    added = (gaps[near] / _SURFACE_STEP_M).astype(np.intp)
    first = np.repeat(near, added)
    number = np.arange(len(first)) - np.repeat(np.cumsum(added) - added, added) + 1
    share = number * np.repeat(1 / (added + 1), added)
    return np.concatenate([points, points[first] + share[:, None] * (points[first + 1] - points[first])])


_BESIDE = 4
"""Number of images on each side of a slip that are compared with those on the other side."""
_RECOGNISED = 0.5
"""Value of r above which two images count as recognised."""
_LEAST_PAIRS = 3
"""Least number of recognised pairs for a verdict; with fewer, odometry is left alone."""
_LEAST_SHARE = 2 / 3
"""Share of these pairs that must agree better with the mended odometry."""


class SlipCheck:
    """Compares the images around slips."""

    def __init__(self, matcher: Matcher) -> None:
        """Compare through `matcher`, whose keyframes contain the drive."""
        self._matcher = matcher
        self.errors: list[NDArray[np.float64]] = []
        """For each confirmed slip, the (P, 3) errors of the mended odometry by the pairs across it."""

    def confirms(self, drive: Sequence[Observation], slip: Slip, around: tuple[int, int]) -> bool:
        """Tell whether the images of a drive, from the first to the last row `around` a slip, agree better after it is
        mended."""
        first, last = around
        before = drive[max(first, slip.row - _BESIDE) : slip.row]
        after = drive[slip.row : min(last, slip.row + _BESIDE - 1) + 1]
        pairs = [*itertools.product(before, after)]
        features = self._matcher.keyframes.features
        reachability, waypoints = self._matcher.match_pairs(
            features([one.step for one, _ in pairs]), features([other.step for _, other in pairs])
        )
        seen = reachability > _RECOGNISED
        if seen.sum() < _LEAST_PAIRS:
            return False
        there = relative(np.array([one.odometry for one, _ in pairs]), before[-1].odometry)
        onward = relative(after[0].odometry, np.array([other.odometry for _, other in pairs]))
        by_odometry, mended = (
            relative(compose(compose(there, moved), onward), waypoints)[seen] for moved in (slip.moved, slip.truly)
        )
        before_d, after_d = distance(by_odometry), distance(mended)
        if (after_d < before_d).mean() < _LEAST_SHARE or np.median(after_d) >= np.median(before_d):
            return False
        self.errors.append(mended)
        return True


def mend_slips(
    observations: Sequence[Observation], matcher: Matcher, progress: Callable[[float], None]
) -> Sequence[Observation]:
    """Return images with odometry corrected for wheel slips, also in the matcher's keyframes, which note it."""
    keyframes = matcher.keyframes
    check = SlipCheck(matcher)
    camera = matcher.predictor.camera
    mended = without_slips(observations, camera, keyframes.odometry_starts, check.confirms, progress)
    if check.errors:
        moved = odometry_of(mended) - odometry_of(observations)
        slips = Correction.of("wheel slips", moved, np.concatenate(check.errors), count=len(check.errors))
        keyframes.corrections.append(slips)
    keyframes.correct(mended)
    return mended
