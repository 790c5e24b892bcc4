"""Loop closures judged by the map that they make.

In a building that repeats, the false closures may outnumber the true ones and agree with each other: then the course
that fits most closures is wrong, and lays corridors over walls. So where one pass of the drive saw an obstacle on floor
that another pass saw free, other courses are tried, which trust odometry more, and the one that makes the fewest
contradictions stays. And where a course bends odometry more than it errs, closures are searched without those across
the bend. Owns these measures (ours).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_scan import RANGE_M, DepthScan, reach_past
from ltvn_core.geometry import compose, wrap_angle
from ltvn_core.graph.pose_graph import OptimisedPoses, RelativePoses, optimise
from ltvn_core.types import Observation, Pose

_TOLERANCE_M = 0.5
"""Error of a good course, in metres: obstacles nearer than this to each other agree."""
_ANOTHER_PASS_M = 4.0
"""Least distance driven between two images that check each other, in metres."""
_CELL_M = 0.15
"""Side of the squares of which one obstacle point is kept from each pass, in metres."""


class PassOverlay:
    """The depth scans of S images of a drive, which any course lays over each other."""

    def __init__(
        self, images: Sequence[Observation], driven_m: NDArray[np.float64], camera: CameraModel, height_m: float
    ) -> None:
        """Read the depth of images, taken after (S,) metres of driving, for a robot of `height_m`.

        Within a pass, where odometry is right, only noise of depth and moving things contradict: that much is usual.
        """
        scans = [DepthScan.from_image(seen, camera, np.zeros(3), height_m=height_m) for seen in images]
        self._any_scan = scans[0]  # All scans of one camera have the same bins.
        self._ranges_m = np.stack([scan.ranges_m for scan in scans])
        self._shown_m = np.stack([scan.shown_m for scan in scans])
        points = [scan.solid_points() for scan in scans]
        self._points = np.concatenate(points)
        self._scan_of = np.repeat(np.arange(len(scans)), [len(each) for each in points])
        self._driven_m = driven_m
        self._usual = self._share(np.array([seen.odometry for seen in images]), within_pass=True)

    def contradicted(self, poses: Pose) -> float:
        """Return by how much the share of contradictions between passes exceeds that within a pass, if the images were
        taken at poses (S, 3); 0 where no pass met another."""
        return max(0.0, self._share(poses, within_pass=False) - self._usual)

    def _share(self, poses: Pose, *, within_pass: bool) -> float:
        """Return the share of the obstacles met again that the later or earlier image saw as free floor."""
        points, scan_of = self._thinned(poses)
        if not len(points):
            return 0.0
        near = KDTree(points).query_ball_point(poses[:, :2], RANGE_M - _TOLERANCE_M)
        scan = np.repeat(np.arange(len(poses)), [len(each) for each in near])
        point = np.concatenate(near).astype(np.intp)
        is_within = np.abs(self._driven_m[scan] - self._driven_m[scan_of[point]]) <= _ANOTHER_PASS_M
        checked = (is_within == within_pass) & (scan != scan_of[point])
        scan, point = scan[checked], point[checked]
        ahead = points[point] - poses[scan, :2]
        away_m = np.hypot(*ahead.T)
        bearing = wrap_angle(np.arctan2(ahead[:, 1], ahead[:, 0]) - poses[scan, 2])
        inside = self._any_scan.inside(bearing)
        scan, point, away_m, bearing = scan[inside], point[inside], away_m[inside], bearing[inside]
        places = np.clip(self._any_scan.bins(bearing), 1, self._ranges_m.shape[1] - 2)
        beside = np.stack([places - 1, places, places + 1])
        met = np.zeros(len(points), np.bool_)
        met[point[(np.abs(self._ranges_m[scan, beside] - away_m) < _TOLERANCE_M).any(axis=0)]] = True
        passed = np.zeros(len(points), np.bool_)
        passed[point[reach_past(self._shown_m[scan, beside], away_m + _TOLERANCE_M)]] = True
        against = int((passed & ~met).sum())
        return against / max(against + int(met.sum()), 1)

    def _thinned(self, poses: Pose) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return obstacles (P, 2) on the map, one of each square and pass, and the rows (P,) of their scans."""
        points = compose(poses[self._scan_of], np.pad(self._points, ((0, 0), (0, 1))))[:, :2]
        passes = self._driven_m[self._scan_of] // _ANOTHER_PASS_M
        cells = np.column_stack([np.round(points / _CELL_M), passes]).astype(np.intp)
        rows = np.unique(cells, axis=0, return_index=True)[1]
        return points[rows], self._scan_of[rows]


_FEW = 0.001
"""Share of contradictions up to which a course is not doubted, and that a better one must have fewer at least: things
move, and depth and course err a little. Over rooms that are all alike, even a course that is 3 m off has only 0.004."""
TOO_MANY = 0.04
"""Share of contradictions above which even the best course proves nothing."""
_BETTER = 0.9
"""Share of the contradictions of a course that a better one may make at most."""
_TRUST = (0.5, 0.35, 0.25, 0.18, 0.125)
"""Factors of the errors of odometry: where many closures agree on a false course, it bends odometry too much."""
_NEAR = 12.0
"""Error in standard deviations up to which a course may still come to agree with a closure."""
_BEND_M, _MOST_BENT = 10.0, 12.0
"""Way in metres over which the squared errors of odometry are summed, in standard deviations, and the sum above which
a false course is suspected, of a robot that took a room for the next one and went on: it is below 4 nearly always."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosureJudgement:
    """Odometry and loop closures between K images of a drive, with what their depth images say about a course."""

    poses: Pose
    """(K, 3) by odometry."""
    odometry: RelativePoses
    closures: RelativePoses
    driven_m: NDArray[np.float64]
    """(K,) distances driven before the images."""
    overlay: PassOverlay

    def surest(self, course: OptimisedPoses, *, along: Pose | None = None) -> "JudgedCourse":
        """Return the course with the fewest contradictions.

        `course` is the one that fits most closures; it is returned itself if no other one has clearly fewer
        contradictions. Courses near `along` (K, 3) are tried, too.
        """
        best = self._judged(course)
        if best.contradicted > _FEW:
            other = min(self._trusting(along), key=lambda each: each.contradicted)
            best = other if other.is_surer_than(best) else best
        return best

    def straightened(self, judged: "JudgedCourse") -> OptimisedPoses | None:
        """Return the course without the closures across the place where a judged one bends odometry most; None if it
        bends it nowhere more than odometry errs, or is not doubted."""
        squared = (self.odometry.errors(judged.course.poses) ** 2).sum(axis=1)
        total = np.concatenate([[0.0], np.cumsum(squared)])
        after = np.searchsorted(self.driven_m, self.driven_m + _BEND_M, side="right") - 1
        first = int((total[after] - total).argmax())
        if judged.contradicted <= _FEW or total[after[first]] - total[first] < _MOST_BENT:
            return None
        bend = first + int(squared[first : after[first]].argmax())
        ends = np.sort([self.closures.first, self.closures.second], axis=0)
        across = (ends[0] <= bend) & (bend < ends[1])
        return optimise(self.poses, self.odometry, self.closures, among=~across)

    def _trusting(self, along: Pose | None) -> Iterator["JudgedCourse"]:
        """Yield courses that bend odometry less, and the one near `along` (K, 3)."""
        if along is not None:
            yield self._judged(self._refined(along))
        for factor in _TRUST:
            trusting = replace(self.odometry, deviations=factor * self.odometry.deviations)
            yield self._judged(self._refined(optimise(self.poses, trusting, self.closures).poses))

    def _judged(self, course: OptimisedPoses) -> "JudgedCourse":
        return JudgedCourse(course, self.overlay.contradicted(course.poses))

    def _refined(self, poses: Pose) -> OptimisedPoses:
        """Return the course that fits the closures best that lie near another course (K, 3)."""
        near = np.linalg.norm(self.closures.errors(poses), axis=1) < _NEAR
        return optimise(self.poses, self.odometry, self.closures, among=near)


class JudgedCourse(NamedTuple):
    """A course of key images, with what the depth images say about it."""

    course: OptimisedPoses
    contradicted: float
    """Share of the obstacles met again where another pass saw free floor."""

    def is_surer_than(self, other: "JudgedCourse") -> bool:
        """Tell whether this course has clearly fewer contradictions than another."""
        return self.contradicted < min(_BETTER * other.contradicted, other.contradicted - _FEW)
