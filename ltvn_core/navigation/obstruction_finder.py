"""Sees what lies across the way of an edge after an attempt that failed.

Owns telling new things from those that were there when the map was made, and things across the way from those beside
it. What it says of the map is `graph.presence.presence_maintenance`.
"""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.geometry import compose, invert, relative
from ltvn_core.graph.localiser import Localisation
from ltvn_core.graph.presence.obstruction import LEAST_POINTS, Obstruction, distances_to_way
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.obstacle_memory import obstacle_points, transform_points
from ltvn_core.navigation.perception import Perception
from ltvn_core.types import NodeId, Pose, Waypoint

_KNOWN_WITHIN_M = 0.25
"""What is so near to something that the mapping drive saw is held to be that."""
_MAPPING_IMAGES = 8
"""So many images of the mapping drive before and after a node tell what stood around it."""
_EXTENT_M = 0.75
"""What is farther than this from where the way is blocked says nothing of other ways: the robot may stand aslant."""
_BODY_M = 0.2
"""What is nearer than this to the line of a way stops the robot's body."""
_GRID_M = 0.05
"""Of points within such a cell one is kept."""


class ObstructionFinder:
    """Compares what stands in the way with the images of the map."""

    def __init__(
        self, context: NavigationContext, motion: MotionExecutor, perception: Perception, driver: AttemptDriver
    ) -> None:
        """Look through `perception`; what was seen on the way is what `driver` remembers."""
        self._context, self._motion = context, motion
        self._perception, self._driver = perception, driver
        self._departure: tuple[Waypoint, Pose] | None = None

    def depart(self, localisation: Localisation) -> None:
        """Remember from where an attempt sets off, if that is sure."""
        sure = localisation.reachability > self._context.method.localising.reachability
        self._departure = (localisation.waypoint, self._motion.odometry) if sure else None

    def find(self, segment: Sequence[NodeId]) -> Obstruction | None:
        """Return what lies across the way of an attempt along nodes that has just failed, None if nothing new does.

        A robot that did not know well where it was, or sees no depth, says nothing.
        """
        if self._context.system.presence is None or self._departure is None or len(segment) < 2:
            return None
        node_seen, odometry = self._departure
        here = compose(invert(node_seen), relative(odometry, self._motion.odometry))
        points = transform_points(_thinned(self._driver.solid_points()), here)
        way = list(self._way(segment))
        return _across(self._unknown(points, segment, way), segment[0], way)

    def _way(self, segment: Sequence[NodeId]) -> Iterator[Pose]:
        """Yield the poses (3,) of the nodes of a segment in the frame of the first."""
        pose = np.zeros(3)
        yield pose
        for edge in itertools.pairwise(segment):
            pose = compose(pose, np.array(self._context.graph.edges[edge].waypoint))
            yield pose

    def _unknown(
        self, points: NDArray[np.float64], segment: Sequence[NodeId], way: Sequence[Pose]
    ) -> NDArray[np.float64]:
        """Return those points that are not near to anything that the images around the nodes show."""
        camera = self._context.spec.camera
        known = [
            transform_points(obstacle_points(image.depth, camera), compose(node_pose, pose))
            for node, node_pose in zip(segment, way, strict=True)
            for image, pose in self._perception.observations_around(node, _MAPPING_IMAGES)
        ]
        mapped = np.concatenate(known)
        if not len(mapped) or not len(points):
            return points
        gaps, _ = KDTree(mapped).query(points)
        return points[np.asarray(gaps) > _KNOWN_WITHIN_M]


def _across(points: NDArray[np.float64], node: NodeId, way: Sequence[Pose]) -> Obstruction | None:
    """Return what blocks the way of the robot's body, with what is around it."""
    for start, end in itertools.pairwise(way):
        inside = points[distances_to_way(points, start[:2], end[:2]) <= _BODY_M]
        if len(inside) >= LEAST_POINTS:
            middle = np.median(inside, axis=0)
            return Obstruction(node, points[np.linalg.norm(points - middle, axis=1) <= _EXTENT_M])
    return None


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    _, kept = np.unique(np.round(points / _GRID_M), axis=0, return_index=True)
    return points[kept]
