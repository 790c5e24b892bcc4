"""Dead reckoning: estimates the robot's place by odometry if the world has changed so much that no image matches.

Owns that estimate, and the test by depth whether a place has changed since the map was made. A robot that fails to
recognise an unchanged place gets no estimate. Decides nothing.
"""

from collections.abc import Callable, Collection, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.depth_points import map_points, obstacle_points, transform_points
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.localiser import LOCAL, Localisation
from ltvn_core.graph.presence.obstruction import nearby_poses
from ltvn_core.graph.presence.presence_maintenance import was_driven
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.perception import Perception
from ltvn_core.types import NodeId, Pose, Waypoint

_AT_NODE_DISTANCE = 0.35
"""Greatest d at which the robot counts as being at a node."""
_RANGE_M = 4.0
"""Range at which depth is capped, in metres."""
_DIRECTIONS = 24
_CHANGED_M, _CHANGED_PART = 0.25, 0.15
"""Least change of the distance to the nearest obstacle in a changed direction, in metres and as a share."""
_CHANGED_SHARE = 0.35
"""Share of changed directions above which a place counts as changed."""
_CERTAIN = 1.0


class DeadReckoning:
    """Dead reckoning from the last place where the robot was recognised."""

    def __init__(self, context: NavigationContext, motion: MotionExecutor, perception: Perception) -> None:
        """Start without an estimate."""
        self._context = context
        self._motion = motion
        self._perception = perception
        self._seen: tuple[NodeId, Waypoint, Pose] | None = None
        self._arrival: tuple[NodeId, Waypoint, Pose] | None = None

    def recognise(self, localisation: Localisation) -> None:
        """Remember a localisation as the start of dead reckoning, if it is certain."""
        sure = localisation.reachability > self._context.method.localising.reachability
        if localisation.node is not None and sure:
            self._seen = localisation.node, localisation.waypoint, self._motion.odometry

    def localise(self) -> Localisation | None:
        """Return the node that the robot is at by odometry, if the place has changed; None otherwise."""
        places = self.places()
        if not places:
            return None
        node = min(places, key=lambda each: float(distance(places[each])))
        return self._at(node, places[node])

    def arrive(
        self, segment: Sequence[NodeId], *, is_recognised: bool, fits_depth: Callable[[NodeId, Waypoint], bool]
    ) -> bool:
        """Tell whether the robot is at the last node of a segment by odometry, and remember the arrival.

        The place must also be recognised, or have changed. An edge that was never driven may be false, and at the end
        of a false edge every place looks changed. So at the end of such an edge, `fits_depth` must confirm by depth
        that the node is at a waypoint (3,).
        """
        graph = self._context.graph
        target = segment[-1]
        here = self._motion.odometry
        edges = [edge for edge in pairwise(segment) if edge in graph.edges]
        place = self.places(without=[edge for edge in edges if not was_driven(graph, graph.edges[edge])]).get(target)
        if place is not None and _is_near(place) and (is_recognised or self._looks_different(target, place)):
            self._arrival = target, place, here
            return True
        place = self.places().get(target)
        if place is not None and _is_near(place) and fits_depth(target, place):
            self._arrival = self._seen = target, place, here
            return True
        self._arrival = None
        return False

    def take_arrival(self) -> Localisation | None:
        """Return the last arrival by dead reckoning if the robot has not moved since, and forget it."""
        arrival, self._arrival = self._arrival, None
        if arrival is None or arrival[0] not in self._context.graph.nodes:
            return None
        node, waypoint, odometry = arrival
        if not np.array_equal(odometry, self._motion.odometry):
            return None
        return Localisation(node, float(distance(waypoint)), _CERTAIN, waypoint, None, np.inf, LOCAL)

    def is_at(self, node: NodeId) -> bool:
        """Tell whether the robot is at a goal node by odometry, if the place has changed."""
        places = self.places()
        return node in places and self._at(node, places[node]) is not None

    def _at(self, node: NodeId, waypoint: Waypoint) -> Localisation | None:
        if not _is_near(waypoint) or not self._looks_different(node, waypoint):
            return None
        return Localisation(node, float(distance(waypoint)), _CERTAIN, waypoint, None, np.inf, LOCAL)

    def places(self, *, without: Collection[EdgeKey] = ()) -> dict[NodeId, Waypoint]:
        """Return the waypoints (3,) by odometry of the nodes around the last recognised one; empty if there is none.

        `without` are edges to leave out.
        """
        if (
            not self._context.system.follows_presence
            or self._seen is None
            or self._seen[0] not in self._context.graph.nodes
        ):
            return {}
        node, waypoint, odometry = self._seen
        here = compose(invert(waypoint), relative(odometry, self._motion.odometry))
        poses = nearby_poses(self._context.graph, node, without=without)
        return {other: relative(here, pose) for other, pose in poses.items()}

    def _looks_different(self, node: NodeId, waypoint: Waypoint) -> bool:
        """Tell whether the distances to the nearest obstacles differ from those in the node's image, in enough
        directions."""
        camera = self._context.spec.camera
        seen = self._perception.observation
        image, _ = next(self._perception.observations_around(node, 0))
        if not (seen.has_depth and image.has_depth):
            return False
        now = transform_points(obstacle_points(seen.depth, camera, _RANGE_M), invert(waypoint))
        half_fov_rad = camera.horizontal_fov_rad / 2
        before_m = _nearest(map_points(image, camera, _RANGE_M), half_fov_rad)
        now_m = _nearest(now, half_fov_rad)
        least = np.maximum(_CHANGED_M, _CHANGED_PART * np.minimum(before_m, now_m))
        bearings = ((np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS * 2 - 1) * half_fov_rad
        in_view = np.abs(bearings + waypoint[2]) < half_fov_rad
        return bool((np.abs(before_m - now_m) > least)[in_view].mean() > _CHANGED_SHARE)


def _nearest(points: NDArray[np.float64], half_fov_rad: float) -> NDArray[np.float64]:
    """Return (_DIRECTIONS,) distances in metres to the nearest of points (M, 2) per direction in a field of view."""
    nearest = np.full(_DIRECTIONS, _RANGE_M)
    bearings = np.arctan2(points[:, 1], points[:, 0])
    inside = np.abs(bearings) < half_fov_rad
    columns = ((bearings[inside] + half_fov_rad) / (2 * half_fov_rad) * _DIRECTIONS).astype(np.intp)
    np.minimum.at(nearest, np.minimum(columns, _DIRECTIONS - 1), np.linalg.norm(points[inside], axis=1))
    return nearest


def _is_near(waypoint: Waypoint) -> bool:
    """Tell whether a node at `waypoint` (3,) is where the robot is."""
    return float(distance(waypoint)) <= _AT_NODE_DISTANCE
