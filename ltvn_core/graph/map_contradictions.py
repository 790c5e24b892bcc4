"""Contradictions within a map: obstacles that one pass of a drive saw where another pass saw free floor.

Where rooms look alike, wrong loop closures may agree with each other. But the course that they make lays corridors over
walls, and that the depth images show. Owns this measure (ours); `graph.closure_judgement` chooses by it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_scan import RANGE_M, DepthScan, reach_past
from ltvn_core.geometry import compose, wrap_angle
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
