"""Loop closures judged by the map that they make.

In a building that repeats, the false closures may outnumber the true ones and agree with each other: then the course
that fits most closures is wrong, and lays corridors over walls. So where one pass of the drive saw an obstacle on floor
that another pass saw free, other courses are tried: some that trust odometry more, some that take a rejected group of
closures for true, some that do without an accepted group. The one that makes the fewest contradictions stays. Owns this
measure and this search (ours).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
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


_FEW = 0.01
"""Share of contradictions up to which a course is not doubted: things move, and depth and course err a little."""
TOO_MANY = 0.04
"""Share of contradictions above which even the best course proves nothing."""
_BETTER = 0.9
"""Share of the contradictions of a course that a better one may make at most."""
_TRUST = (0.5, 0.35, 0.25, 0.18, 0.125)
"""Factors of the errors of odometry: where many closures agree on a false course, it bends odometry too much."""
_ACCEPTED_M, _REJECTED_M = 6.0, 3.0
"""Distance along the drive, at both ends, within which accepted or rejected closures are one group, in metres."""
_GROUPS = 8
"""Largest number of groups of each kind that are tried around one course, the largest first."""
_MOST_TRIED = 48
_NEAR = 12.0
"""Error in standard deviations up to which a course may still come to agree with a closure."""
_MOVES_M = 0.3
"""Least distance in metres by which another course moves an image."""


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
            best = other if other.contradicted < _BETTER * best.contradicted else best
        tried = set[bytes]()
        while best.contradicted > _FEW and (better := self._better(best, tried)) is not None:
            best = better
        return best

    def _trusting(self, along: Pose | None) -> Iterator["JudgedCourse"]:
        """Yield courses that bend odometry less, and the one near `along` (K, 3)."""
        if along is not None:
            yield self._judged(self._refined(along))
        for factor in _TRUST:
            trusting = replace(self.odometry, deviations=factor * self.odometry.deviations)
            yield self._judged(self._refined(optimise(self.poses, trusting, self.closures).poses))

    def _better(self, best: "JudgedCourse", tried: set[bytes]) -> "JudgedCourse | None":
        """Return the first course with a group of closures more or less that has clearly fewer contradictions."""
        for course in self._others(best.course, tried):
            if np.abs(course.poses - best.course.poses)[:, :2].max() >= _MOVES_M:
                other = self._judged(course)
                if other.contradicted < _BETTER * best.contradicted:
                    return other
        return None

    def _others(self, best: OptimisedPoses, tried: set[bytes]) -> Iterator[OptimisedPoses]:
        """Yield courses that take a rejected group for true, then those that do without an accepted one, each once."""
        for rejected in (True, False):
            among, reach_m = (~best.kept, _REJECTED_M) if rejected else (best.kept, _ACCEPTED_M)
            for group in self._groups(among, reach_m):
                key = bytes([rejected]) + group.tobytes()
                if key in tried or len(tried) >= _MOST_TRIED:
                    continue
                tried.add(key)
                chosen = {"sure": group} if rejected else {"among": ~group}
                yield optimise(self.poses, self.odometry, self.closures, **chosen)

    def _judged(self, course: OptimisedPoses) -> "JudgedCourse":
        return JudgedCourse(course, self.overlay.contradicted(course.poses))

    def _refined(self, poses: Pose) -> OptimisedPoses:
        """Return the course that fits the closures best that lie near another course (K, 3)."""
        near = np.linalg.norm(self.closures.errors(poses), axis=1) < _NEAR
        return optimise(self.poses, self.odometry, self.closures, among=near)

    def _groups(self, closures: NDArray[np.bool_], reach_m: float) -> Iterator[NDArray[np.bool_]]:
        """Yield masks (C,) of the largest groups of some closures (C,): those between the same two stretches."""
        rows = np.flatnonzero(closures)
        ends_m = self.driven_m[np.stack([self.closures.first[rows], self.closures.second[rows]], axis=-1)]
        for group in stretch_pairs(ends_m, reach_m)[:_GROUPS]:
            yield np.isin(np.arange(len(closures)), rows[group])


def stretch_pairs(ends_m: NDArray[np.float64], reach_m: float) -> list[NDArray[np.intp]]:
    """Return the groups of closures (C,) between the same two stretches, the largest first.

    `ends_m` (C, 2) are the distances driven before their images; those of neighbours differ by at most `reach_m`.
    """
    first, second = KDTree(ends_m).query_pairs(reach_m, p=np.inf, output_type="ndarray").T
    near = coo_array((np.ones(len(first)), (first, second)), shape=(len(ends_m), len(ends_m)))
    _, group_of = connected_components(near, directed=False)
    return [np.flatnonzero(group_of == number) for number in np.argsort(-np.bincount(group_of), kind="stable")]


class JudgedCourse(NamedTuple):
    """A course of key images, with what the depth images say about it."""

    course: OptimisedPoses
    contradicted: float
    """Share of the obstacles met again where another pass saw free floor."""
