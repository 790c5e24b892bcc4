"""Finds obstacles around the robot that were not there when the map was made.

Owns the distinction between new and known obstacles, and between obstacles on the path and beside it.
`graph.presence.obstruction` finds the edges that they close. `FreeView` knows how far the floor is free in each
direction.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_points import are_solid, map_points, obstacle_points, points_within, transform_points
from ltvn_core.geometry import compose, invert, relative
from ltvn_core.graph.localiser import Localisation
from ltvn_core.graph.presence.obstruction import (
    BODY_M,
    Obstruction,
    distances_to_way,
    edges_obstructed,
    nearby_poses,
    ways_nearby,
)
from ltvn_core.graph.presence.presence_observations import is_open
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.perception import Perception
from ltvn_core.types import Depth, NodeId, Pose, Waypoint

_BEARING_STEP_RAD = math.radians(2.2)
"""Width of one direction, in radians; wider than two pixels, so that every direction contains some pixels."""
_EDGE_RAD = math.radians(3.0)
"""Margin at the edge of an image within which nothing is known, in radians."""
_FREE_RANGE_M = 3.5
"""Range up to which floor may count as free, in metres; farther away, a door leaf seen at an angle looks like a gap."""
_BEHIND_M = 0.15
"""Distance behind a place up to which nothing may be seen if the place is free, in metres."""
_BEYOND_M = 0.25
"""Length before and behind a path that must also be free, in metres."""
_UNDERFOOT_M = 0.3
"""Radius of the area that the robot itself covers, in metres."""
_STEP_M = 0.08
"""Spacing of the places at which a path is checked, in metres."""


class FreeView:
    """Free floor that one image shows."""

    def __init__(self, depth: Depth | None, camera: CameraModel) -> None:
        """Read a depth image; without one, no floor is free."""
        self._half_rad = camera.horizontal_fov_rad / 2
        self._ranges_m = np.zeros(int(2 * self._half_rad / _BEARING_STEP_RAD) + 1)
        """Range in metres to the nearest obstacle per bearing; over `_FREE_RANGE_M` without any, 0 if unknown."""
        if depth is not None:
            seen = points_within(depth, camera, 2 * _FREE_RANGE_M)
            columns = self._columns(np.arctan2(seen[:, 1], seen[:, 0]))
            self._ranges_m[columns] = _FREE_RANGE_M + _BEHIND_M
            solid = are_solid(seen)
            np.minimum.at(self._ranges_m, columns[solid], np.hypot(seen[solid, 0], seen[solid, 1]))

    def shows_free(self, way: NDArray[np.float64]) -> bool:
        """Tell whether a whole straight line (2, 2), start and end in the robot's frame, is seen to be free.

        Both ends need free room as well, because an obstacle may stand just behind them.
        """
        along = (way[1] - way[0]) / max(float(np.hypot(*(way[1] - way[0]))), 1e-9)
        start = way[0] - _BEYOND_M * along
        end = way[1] + _BEYOND_M * along
        count = max(2, math.ceil(float(np.hypot(*(end - start))) / _STEP_M) + 1)
        places = np.linspace(start, end, count)
        away_m = np.hypot(places[:, 0], places[:, 1])
        places, away_m = places[away_m > _UNDERFOOT_M], away_m[away_m > _UNDERFOOT_M]
        bearings = np.arctan2(places[:, 1], places[:, 0])
        if not len(places) or np.abs(bearings).max() > self._half_rad - _EDGE_RAD or away_m.max() > _FREE_RANGE_M:
            return False
        columns = np.clip(self._columns(bearings), 1, len(self._ranges_m) - 2)
        beside_m = self._ranges_m[np.stack([columns - 1, columns, columns + 1])]
        return bool((beside_m >= away_m + _BEHIND_M).all())

    def _columns(self, bearings: NDArray[np.float64]) -> NDArray[np.intp]:
        columns = np.floor((bearings + self._half_rad) / _BEARING_STEP_RAD).astype(np.intp)
        return np.clip(columns, 0, len(self._ranges_m) - 1)


_RANGE_M = 2.5
"""Range up to which depth locates obstacles well enough, in metres."""
_KNOWN_WITHIN_M = 0.18
"""Distance to a point in an image of the map within which a point counts as known, in metres."""
_NODES = 12
"""Number of nearest nodes whose images show the known obstacles."""
_IMAGES_AROUND = 3
"""Number of images of the mapping drive before and after each of these nodes that are also used."""
_SURE_REACHABILITY = 0.8
_KNOWN_SHARE, _KNOWN_SHARE_IF_UNSURE = 0.5, 0.75
"""Share of known surroundings below which the robot's localisation is probably wrong; the second is for an unsure
localisation. In 62 checks in two apartments with closed doors, these limits accepted all 50 at the right place and none
of the 12 at a wrong place."""
_LEAST_POINTS = 8
"""Minimum number of new points that count as an obstruction."""
_LEAST_ON_WAY = 4
"""Minimum number of new points inside the robot's swept path."""
_GRID_M = 0.05
"""Width of a grid cell in which only one point is kept, in metres."""
_CELLS = 1 << 32
"""Stride of a row of cells, larger than any row."""


class ObstructionFinder:
    """Compares the surroundings with the images of the map."""

    def __init__(
        self, context: NavigationContext, motion: MotionExecutor, perception: Perception, driver: AttemptDriver
    ) -> None:
        """Use the images of `perception`; `driver` remembers obstacles seen on the way."""
        self._context = context
        self._motion = motion
        self._perception = perception
        self._driver = driver
        self._departure: tuple[Waypoint, Pose] | None = None
        self._node: NodeId | None = None
        self._needed_share = _KNOWN_SHARE

    def depart(self, localisation: Localisation) -> None:
        """Remember the place of departure, if it is certain enough and the system uses observations of presence."""
        unsure = localisation.reachability < _SURE_REACHABILITY
        self._needed_share = _KNOWN_SHARE_IF_UNSURE if unsure else _KNOWN_SHARE
        believed = localisation.reachability > self._context.method.localising.reachability
        is_of_use = believed and self._context.system.follows_presence
        self._node = localisation.node
        self._departure = (localisation.waypoint, self._motion.odometry) if is_of_use else None

    def open_ways(self) -> list[EdgeKey]:
        """Return the edges that were last seen closed, but whose paths are now seen to be free."""
        if self._departure is None or self._node is None:
            return []
        graph = self._context.graph
        node = self._node
        closed = {key for key in graph.presence if not is_open(graph, key)}
        if not closed:
            return []
        back = invert(self._here())
        view = FreeView(self._perception.observation.depth, self._context.spec.camera)
        ways = {key: way for key, way in ways_nearby(graph, node).items() if key in closed}
        return [key for key, way in ways.items() if view.shows_free(transform_points(way, back))]

    def look(self, segment: Sequence[NodeId]) -> Obstruction | None:
        """Return the result of `find` if anything lies across the path of a nearby edge, which is cheap to check."""
        if self._departure is None or len(segment) < 2:
            return None
        solid = self._solid_points(self._here())
        anything = Obstruction(node=segment[0], points=solid, known=solid[:0], stopped=False)
        return self.find(segment) if edges_obstructed(self._context.graph, anything) else None

    def find(self, segment: Sequence[NodeId], *, blocked: bool = False, again: bool = False) -> Obstruction | None:
        """Return the new obstacles around the robot on its path along nodes; None without any.

        Nothing is reported while the robot's place is uncertain. `blocked` means that an obstacle stopped the robot.
        `again` means that one stopped it on this edge before; the obstacle then counts as being in the way, even if no
        image shows it there.
        """
        if self._departure is None or len(segment) < 2:
            return None
        here = self._here()
        solid = self._solid_points(here)
        is_new = self._is_new(solid, segment[0], here)
        new = solid[is_new]
        if len(new) > (1 - self._needed_share) * len(solid):
            return None
        if blocked:
            new = np.concatenate([new, self._hit_unseen(segment[0], here)])
        stopped = blocked and (again or self._is_on_way(new, segment))
        if not stopped and len(new) < _LEAST_POINTS:
            return None
        return Obstruction(node=segment[0], points=new, known=solid[~is_new], stopped=stopped)

    def _here(self) -> Pose:
        """Return the robot's pose (3,) in the frame of the node that it departed from."""
        assert self._departure is not None
        node_seen, odometry = self._departure
        return compose(invert(node_seen), relative(odometry, self._motion.odometry))

    def _solid_points(self, here: Pose) -> NDArray[np.float64]:
        """Return (M, 2) solid points that a robot at a pose (3,) sees now or saw nearby recently, thinned out."""
        seen = obstacle_points(self._perception.observation.depth, self._context.spec.camera, _RANGE_M)
        return _thinned(transform_points(np.concatenate([seen, self._driver.solid_points()]), here))

    def _hit_unseen(self, node: NodeId, here: Pose) -> NDArray[np.float64]:
        """Return (M, 2) points of a collision with an obstacle that no image showed, in the frame of a node.

        This happens when the robot backs up. Collisions with known obstacles, or beside them, are left out.
        """
        hit = transform_points(self._driver.hit_points(), here)
        return hit if self._is_new(hit, node, here).all() else hit[:0]

    def _is_new(self, points: NDArray[np.float64], node: NodeId, here: Pose) -> NDArray[np.bool_]:
        """Return which points (M,), in the frame of a node, are far from all points in the images of the map."""
        poses = nearby_poses(self._context.graph, node)
        nearest = sorted(poses, key=lambda other: float(np.hypot(*(poses[other] - here)[:2])))[:_NODES]
        return _is_new_to(points, self._images_of([(other, poses[other]) for other in nearest]))

    def _images_of(self, nodes: Sequence[tuple[NodeId, Pose]]) -> NDArray[np.float64]:
        """Return (M, 2) points in the images around nodes, each node at a pose (3,)."""
        camera = self._context.spec.camera
        return np.concatenate(
            [
                transform_points(map_points(image, camera, 2 * _RANGE_M), compose(place, pose))
                for node, place in nodes
                for image, pose in self._perception.observations_around(node, _IMAGES_AROUND)
            ]
        )

    def _is_on_way(self, points: NDArray[np.float64], segment: Sequence[NodeId]) -> bool:
        """Tell whether points in the frame of the first node lie in the path of the robot's body."""
        start = np.zeros(3)
        for edge in itertools.pairwise(segment):
            end = compose(start, np.array(self._context.graph.edges[edge].waypoint))
            if (distances_to_way(points, start[:2], end[:2]) <= BODY_M).sum() >= _LEAST_ON_WAY:
                return True
            start = end
        return False


def _is_new_to(points: NDArray[np.float64], mapped: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (M,) are far from all mapped points (N, 2)."""
    mapped = _thinned(mapped)
    if not len(mapped) or not len(points):
        return np.ones(len(points), np.bool_)
    gaps, _ = KDTree(mapped).query(points)
    return np.asarray(gaps) > _KNOWN_WITHIN_M


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    cells = np.round(points / _GRID_M).astype(np.int64)
    _, kept = np.unique(cells[:, 0] * _CELLS + cells[:, 1], return_index=True)
    return points[kept]
