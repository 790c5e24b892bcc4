"""Free floor: the part of the floor that the depth images of a drive show to be free, located by odometry.

Owns when a straight line counts as free. Knows nothing of the graph.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_points import transform_points
from ltvn_core.cameras.depth_scan import EDGE_RAD, FREE_BEYOND_M, RANGE_M, DepthScan, bearing_bins, reach_past
from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.presence.obstruction import distances_to_way
from ltvn_core.types import NodeId, Observation, Pose

_CLEAR_M = 0.3
"""Clearance needed on both sides of a path: half a small robot plus the error of odometry, in metres."""
_STOOD_M = 0.18
"""Radius around the place of an image within which the floor is free, in metres."""
_SPACING_M, _FEW = 0.1, 8
"""Distance between the points of a line that are checked, in metres; every `_FEW`th of them is checked first."""
WELL_KNOWN_M = 10.0
"""Greatest distance along the drive over which odometry is accurate, in metres."""


class FreeFloor:
    """The floor as seen by the images of some frames."""

    def __init__(self, seen: Sequence[Observation], camera: CameraModel, gate: OdometryGate) -> None:
        """Read the depth of images; one without depth only shows that a robot stood there."""
        scans = [DepthScan.from_image(each, camera, np.zeros(3)) for each in seen]
        self._rows = gate.rows([each.step for each in seen])
        self._gate = gate
        self._half_rad = scans[0].half_rad
        self._ranges_m = np.stack([scan.ranges_m for scan in scans])
        self._things = [scan.solid_points() for scan in scans]

    def joins(self, source: NodeId, target: Matches) -> bool:
        """Tell whether images around both ends saw the straight line from a node to the only target free, with no
        obstacle near it."""
        way = _along(target.waypoints[0, :2])
        poses, driven_m = self._gate.seen_from(source, self._rows)
        _, back_m = self._gate.seen_from(target.nodes[0], self._rows)
        in_range = distances_to_way(poses[:, :2], way[0], way[-1]) < RANGE_M
        near = np.flatnonzero((np.minimum(driven_m, back_m) <= WELL_KNOWN_M) & in_range)
        # Most lines lead through a wall, and a few of their points show it.
        if not all(self._is_free(points, near, poses[near]) for points in (way[::_FEW], way)):
            return False
        solid = np.concatenate([np.empty((0, 2)), *(transform_points(self._things[k], poses[k]) for k in near)])
        return not len(solid) or bool(KDTree(solid).query(way)[0].min() > _CLEAR_M)

    def _is_free(self, way: NDArray[np.float64], images: NDArray[np.intp], poses: Pose) -> bool:
        """Tell whether every point (S, 2) was seen to be free by one of N images at poses (N, 3), or lies where one was
        taken."""
        offset = way - poses[:, None, :2]
        away_m = np.hypot(offset[..., 0], offset[..., 1])
        bearing = wrap_angle(np.arctan2(offset[..., 1], offset[..., 0]) - poses[:, 2:])
        inside = np.abs(bearing) < self._half_rad - EDGE_RAD
        place = np.clip(bearing_bins(bearing, self._half_rad), 1, self._ranges_m.shape[1] - 2)
        beside = np.stack([self._ranges_m[images[:, None], place + aside] for aside in (-1, 0, 1)])
        seen = inside & reach_past(beside, away_m + FREE_BEYOND_M)
        return bool((seen | (away_m < _STOOD_M)).any(axis=0).all())


def _along(end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (S, 2) on the straight line from the origin to an end (2,)."""
    count = max(int(np.hypot(*end) / _SPACING_M), 1) + 1
    return np.linspace(0, 1, count)[:, None] * end
