"""Where the robot is by odometry, where a change of the world keeps it from recognising the place.

Owns that guess, and telling by depth that a place cannot look as it did when the map was made. A robot that merely does
not recognise where it is gets no answer. Decides nothing.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.localiser import LOCAL, Localisation
from ltvn_core.graph.presence.obstruction import nearby_poses
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.depth_points import obstacle_points, transform_points
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.perception import Perception
from ltvn_core.types import NodeId, Pose, Waypoint

_AT_NODE_DISTANCE = 0.35
"""The robot is at a node that is nearer than this d."""
_RANGE_M = 4.0
"""What is farther away counts as so far."""
_DIRECTIONS = 24
_CHANGED_M, _CHANGED_PART = 0.25, 0.15
"""A place has changed in a direction where it is so much nearer or farther to the next thing, and by such a part."""
_CHANGED_SHARE = 0.35
"""It looks different where it has changed in so many directions."""
_CERTAIN = 1.0


class DeadReckoning:
    """Goes on from where the robot was recognised last."""

    def __init__(self, context: NavigationContext, motion: MotionExecutor, perception: Perception) -> None:
        """Know nothing yet."""
        self._context, self._motion, self._perception = context, motion, perception
        self._seen: tuple[NodeId, Waypoint, Pose] | None = None

    def recognise(self, localisation: Localisation) -> None:
        """Remember where the robot recognised a node, if that is sure."""
        sure = localisation.reachability > self._context.method.localising.reachability
        if localisation.node is not None and sure:
            self._seen = localisation.node, localisation.waypoint, self._motion.odometry

    def localise(self) -> Localisation | None:
        """Return the node at which the robot is where that cannot look as it did; None if there is none."""
        places = self.places()
        if not places:
            return None
        node = min(places, key=lambda each: float(distance(places[each])))
        return self._at(node, places[node])

    def is_at(self, node: NodeId) -> bool:
        """Tell whether the robot stands at a node as at a goal, where that cannot look as it did."""
        places, judging = self.places(), self._context.method.judging
        if node not in places or abs(places[node][2]) > judging.arrive_yaw_rad:
            return False
        return self._at(node, places[node]) is not None

    def _at(self, node: NodeId, waypoint: Waypoint) -> Localisation | None:
        away = float(distance(waypoint))
        if away > _AT_NODE_DISTANCE or not self._looks_different(node, waypoint):
            return None
        return Localisation(node, away, _CERTAIN, waypoint, None, np.inf, LOCAL)

    def places(self) -> dict[NodeId, Waypoint]:
        """Return the nodes around where the robot was recognised last, each (3,) in its frame now; none if unknown."""
        if (
            self._context.system.presence is None
            or self._seen is None
            or self._seen[0] not in self._context.graph.nodes
        ):
            return {}
        node, waypoint, odometry = self._seen
        here = compose(invert(waypoint), relative(odometry, self._motion.odometry))
        return {other: relative(here, pose) for other, pose in nearby_poses(self._context.graph, node).items()}

    def _looks_different(self, node: NodeId, waypoint: Waypoint) -> bool:
        """Compare how far it is to the next thing in each direction, now and when the node's image was taken."""
        camera, seen = self._context.spec.camera, self._perception.observation
        image, _ = next(self._perception.observations_around(node, 0))
        if not (seen.has_depth and image.has_depth):
            return False
        now = transform_points(obstacle_points(seen.depth, camera, _RANGE_M), invert(waypoint))
        half_fov_rad = camera.horizontal_fov_rad / 2
        before_m = _nearest(obstacle_points(image.depth, camera, _RANGE_M), half_fov_rad)
        now_m = _nearest(now, half_fov_rad)
        least = np.maximum(_CHANGED_M, _CHANGED_PART * np.minimum(before_m, now_m))
        bearings = ((np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS * 2 - 1) * half_fov_rad
        in_view = np.abs(bearings + waypoint[2]) < half_fov_rad
        return bool((np.abs(before_m - now_m) > least)[in_view].mean() > _CHANGED_SHARE)


def _nearest(points: NDArray[np.float64], half_fov_rad: float) -> NDArray[np.float64]:
    """Return (_DIRECTIONS,) the metres to the nearest of points (M, 2) in each direction within a field of view."""
    nearest = np.full(_DIRECTIONS, _RANGE_M)
    bearings = np.arctan2(points[:, 1], points[:, 0])
    inside = np.abs(bearings) < half_fov_rad
    columns = ((bearings[inside] + half_fov_rad) / (2 * half_fov_rad) * _DIRECTIONS).astype(np.intp)
    np.minimum.at(nearest, np.minimum(columns, _DIRECTIONS - 1), np.linalg.norm(points[inside], axis=1))
    return nearest
