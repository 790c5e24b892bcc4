"""Free floor: the part of the floor that the depth images of a drive show to be free, located by odometry.

Owns when a straight line counts as free. Knows nothing of the graph.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_points import are_solid, cell_keys, points_within, transform_points
from ltvn_core.cameras.depth_scan import RANGE_M, DepthScan, reach_past
from ltvn_core.geometry import compose, invert, wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.presence.obstruction import distances_to_way
from ltvn_core.robots.robot_spec import NeededSpace
from ltvn_core.types import NodeId, Observation, Pose, Waypoint

_MARGIN_M = 0.12
"""Clearance needed beside the robot, in metres: the errors of depth, and of odometry over a few metres."""
_THING_M = 0.04
"""Side of the squares of which one solid point is kept, in metres."""
_SPACING_M = 0.1
_FEW, _CELL_M = 16, 0.1
"""Number of points of a line in a quick test, and the cells of its grid, in metres."""
_REACH = np.arange(-round(RANGE_M / _CELL_M), round(RANGE_M / _CELL_M) + 1)
_AROUND = np.stack(np.meshgrid(_REACH, _REACH), axis=-1).reshape(-1, 2)
"""Cells (C, 2) in the range of a scan, relative to the cell of its image."""
_MERGED_AT_ONCE = 64
"""Number of images whose cells are sorted at once."""
LONGEST_M = 8.0
"""Greatest length of a line, in metres."""
WELL_KNOWN_M = 10.0
"""Greatest distance along the drive over which odometry is accurate, in metres."""


class FreeFloor:
    """The floor as seen by the images of some frames."""

    def __init__(
        self, seen: Sequence[Observation], camera: CameraModel, gate: OdometryGate, space: NeededSpace
    ) -> None:
        """Read the depth of images; one without depth only shows that a robot stood there."""
        self._space = space
        self._clear_m = space.radius_m + _MARGIN_M
        scans, self._things = zip(*(_read(each, camera, space) for each in seen), strict=True)
        self._rows = gate.rows([each.step for each in seen])
        self._gate = gate
        self._any_scan = scans[0]  # All scans of one camera have the same bins.
        self._shown_m = np.stack([scan.shown_m for scan in scans])
        self._near: dict[NodeId, tuple[NDArray[np.intp], Pose, NDArray[np.float64]]] = {}
        self._stretch_of, poses = gate.stretch[self._rows], gate.poses[self._rows]
        own = {stretch: np.flatnonzero(self._stretch_of == stretch) for stretch in np.unique(self._stretch_of).tolist()}
        self._stretches = {stretch: self._stretch(images, poses[images]) for stretch, images in own.items()}

    def may_join(self, source: int, targets: NDArray[np.intp], waypoints: Waypoint) -> NDArray[np.bool_]:
        """Tell (M,) whether any images saw straight lines free that lead from the image in a row to waypoints (M, 3).

        A quick test that excludes most lines, because these lead through walls; `targets` are the rows (M,) of the
        images there. Lines to another stretch of odometry may be free by the images of either.
        """
        stretch, others = self._gate.stretch[source], self._gate.stretch[targets]
        points = np.linspace(0, 1, _FEW + 2)[1:-1, None, None] * waypoints[:, :2]
        seen = self._stretches[int(stretch)].shows(transform_points(points.reshape(-1, 2), self._gate.poses[source]))
        seen = seen.reshape(_FEW, len(waypoints))
        for k in np.flatnonzero(others != stretch):
            there = compose(self._gate.poses[targets[k]], invert(waypoints[k]))
            seen[:, k] |= self._stretches[int(others[k])].shows(transform_points(points[:, k], there))
        return np.logical_and.reduce(seen, axis=0)

    def joins(self, source: NodeId, target: Matches, *, error_m: float = 0.0) -> bool:
        """Tell whether images around both ends saw the straight line from a node to the only target free, with no
        obstacle near it; an error of the target's place needs more room."""
        clear_m = self._space.radius_m + float(np.hypot(_MARGIN_M, error_m / 2))
        end = target.waypoints[0, :2]
        way = np.linspace(0, 1, max(int(np.hypot(*end) / _SPACING_M), 1) + 1)[:, None] * end
        (row,) = self._gate.rows([source])
        number = self._gate.stretch[row]
        stretch = self._stretches[int(number)]
        line = transform_points(way, self._gate.poses[row])
        own = stretch.images[distances_to_way(stretch.places, line[0], line[-1]) < RANGE_M]
        elsewhere, poses_there, path_there_m = self._elsewhere(source)
        images = np.concatenate([own, elsewhere])
        poses, driven_m = self._gate.seen_from(source, self._rows[own])
        poses = np.concatenate([poses, poses_there])
        near = distances_to_way(poses[:, :2], way[0], way[-1]) < RANGE_M
        images, poses, driven_m = images[near], poses[near], np.concatenate([driven_m, path_there_m])[near]
        _, back_m = self._gate.seen_from(target.nodes[0], self._rows[images])
        path_m = np.minimum(driven_m, back_m)
        well = path_m <= WELL_KNOWN_M
        if not self._seen_free(way, images[well], poses[well]).any(axis=0).all() or stretch.blocks(line, clear_m):
            return False
        # A thing blocks the way however long ago it was seen.
        others = (self._stretch_of[images] != number) & np.isfinite(path_m)
        things = [transform_points(self._things[k], at) for k, at in zip(images[others], poses[others], strict=True)]
        return not any((np.linalg.norm(way[:, None] - each, axis=-1) <= clear_m).any() for each in things)

    def _elsewhere(self, source: NodeId) -> tuple[NDArray[np.intp], Pose, NDArray[np.float64]]:
        """Return the images (K,) of other stretches that a line from a node may pass, their poses (K, 3) in its frame,
        and the lengths (K,) of the odometry paths to them, infinite if the pose is unknown."""
        if source not in self._near:
            images = np.flatnonzero(self._stretch_of != self._gate.stretch[self._gate.rows([source])])
            poses, driven_m = self._gate.seen_from(source, self._rows[images])
            near = np.hypot(poses[:, 0], poses[:, 1]) < LONGEST_M + RANGE_M
            self._near[source] = images[near], poses[near], driven_m[near]
        return self._near[source]

    def _stretch(self, images: NDArray[np.intp], poses: Pose) -> "_Stretch":
        """Return what N images of one stretch at poses (N, 3) show."""
        things = [transform_points(self._things[k], pose) for k, pose in zip(images, poses, strict=True)]
        return _Stretch(images, poses[:, :2], self._floor(images, poses), KDTree(thinned(np.concatenate(things))))

    def _floor(self, images: NDArray[np.intp], poses: Pose) -> NDArray[np.int64]:
        """Return the keys (K,) of the cells that N images of one stretch at poses (N, 3) saw free, and of those beside
        them."""
        keys = np.empty(0, np.int64)
        for first in range(0, len(images), _MERGED_AT_ONCE):
            rows = range(first, min(first + _MERGED_AT_ONCE, len(images)))
            keys = np.unique(np.concatenate([keys, *(self._free_cells(images[row], poses[row]) for row in rows)]))
        beside = cell_keys(np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2))
        return np.unique(keys[:, None] + beside)

    def _free_cells(self, image: np.intp, pose: Pose) -> NDArray[np.int64]:
        """Return the keys (K,) of the cells that one image at a pose (3,) saw free."""
        cells = _cells(pose[None, :2]) + _AROUND
        places = np.asarray(cells * _CELL_M, np.float64)
        return cell_keys(cells[self._seen_free(places, np.array([image]), pose[None])[0]])

    def _seen_free(self, way: NDArray[np.float64], images: NDArray[np.intp], poses: Pose) -> NDArray[np.bool_]:
        """Tell (N, S) which points (S, 2) each of N images at poses (N, 3) saw free, or was taken at."""
        offset = way - poses[:, None, :2]
        away_m = np.hypot(offset[..., 0], offset[..., 1])
        bearing = wrap_angle(np.arctan2(offset[..., 1], offset[..., 0]) - poses[:, 2:])
        inside = self._any_scan.inside(bearing)
        place = np.clip(self._any_scan.bins(bearing), 1, self._shown_m.shape[1] - 2)
        beside = np.stack([self._shown_m[images[:, None], place + aside] for aside in (-1, 0, 1)])
        return (inside & reach_past(beside, away_m + self._clear_m)) | (away_m < self._space.radius_m)


class _Stretch(NamedTuple):
    """What the N images of one stretch of unbroken odometry show, in its odometry frame."""

    images: NDArray[np.intp]
    """(N,) numbers of the images."""
    places: NDArray[np.float64]
    """(N, 2) places of the images."""
    floor: NDArray[np.int64]
    """(K,) sorted keys of the cells of floor that was seen free, one cell wider than seen; it grows with the floor."""
    things: KDTree
    """Solid points (M, 2) of all images."""

    def shows(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell (M,) which points (M, 2) in the odometry frame were seen free."""
        asked = cell_keys(_cells(points))
        return np.append(self.floor, np.iinfo(np.int64).max)[np.searchsorted(self.floor, asked)] == asked

    def blocks(self, line: NDArray[np.float64], clear_m: float) -> bool:
        """Tell whether an image shows a solid point near a line (S, 2)."""
        return bool(self.things.n) and bool((self.things.query(line)[0] <= clear_m).any())


def _cells(points: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.round(points / _CELL_M).astype(np.int64)


def _read(seen: Observation, camera: CameraModel, space: NeededSpace) -> tuple[DepthScan, NDArray[np.float64]]:
    """Return the scan of an image and its solid points (M, 2), both relative to the image.

    Every pixel is read: the edge of a table is one or two pixels high.
    """
    points = np.empty((0, 3)) if seen.depth is None else points_within(seen.depth, camera, RANGE_M, every=1)
    scan = DepthScan.of(camera, seen.stamp, np.zeros(3), points, space.height_m)
    return scan, thinned(points[are_solid(points, space.height_m), :2])


def thinned(points: NDArray[np.float64], side_m: float = _THING_M) -> NDArray[np.float64]:
    """Return one of the points (M, 2) in each square of this side, in metres."""
    _, kept = np.unique(cell_keys(np.round(points / side_m).astype(np.int64)), return_index=True)
    return points[kept]
