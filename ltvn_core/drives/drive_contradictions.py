"""What a later drive saw that speaks against the map of earlier ones: ways that are blocked now, or open again.

Owns which images of the later drive are asked, and how many must agree. What is new in a depth image lies where no
image of the earlier drives shows anything solid; which edges it closes is `graph.presence.obstruction`.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.drives.joined_drives import JoinedDrive
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.graph.presence.obstruction import Obstruction, distances_to_way, edges_obstructed, nearby_poses
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.depth_points import obstacle_points, transform_points
from ltvn_core.types import NodeId, Observation, Pose, Predictor, Waypoint

_RANGE_M = 2.5
"""Things farther away are not placed well enough."""
_KNOWN_WITHIN_M = 0.18
"""What is so near to something that an earlier image shows is held to be that."""
_KNOWN_SHARE = 0.5
"""Where less of what stands around is known, the image was probably taken elsewhere."""
_LEAST_POINTS = 8
_NODES, _IMAGES_AROUND = 12, 3
"""The images of so many earlier nodes, and so many before and after each, tell what was there."""
_GRID_M = 0.05
_ASK_EVERY = 0.35
"""Images of a drive that are nearer to each other than this d are asked once."""
_DRIVEN_ON = 2.5
"""So far, as d, odometry tells where an image was taken after another that was recognised."""
_LEAST_LOOKS = 2
"""Images that must agree that an edge is blocked."""
_ON_WAY_M = 0.25
"""A robot that was so near to the middle of an edge drove there."""


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where an image of a later drive was taken."""

    node: NodeId
    """A node of an earlier drive,"""
    pose: Pose
    """and the robot (3,) in its frame."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveComparison:
    """What a later drive says of the map of earlier ones."""

    asked: int
    """Images that were compared with it,"""
    recognised: int
    """and of them those whose place was known."""
    observed: tuple[PresenceObserved, ...]
    """Edges that the drive saw blocked, or found open that had been blocked."""

    @property
    def share(self) -> float:
        """Share of the images whose place was known."""
        return self.recognised / self.asked if self.asked else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class DriveContradictions:
    """Compares later drives with the map of earlier ones."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    predictor: Predictor
    system: NavigationSystem

    def compare(self, observations: Sequence[Observation], drive: JoinedDrive) -> DriveComparison:
        """Compare the images of a drive, in order, with the nodes of those before; linear in both."""
        earlier = [node for node in self.graph.nodes if node < drive.first]
        asked = _spread(observations) if earlier else []
        blocked, passed, stamp, recognised = Counter[EdgeKey](), set[EdgeKey](), 0.0, 0
        last: tuple[_Place, Observation] | None = None
        for seen in asked:
            place = self._place(seen, earlier)
            if place is not None:
                recognised += 1
                last = place, seen
            elif last is not None:
                place = _driven_on(*last, seen)
            if place is None:
                continue
            stamp = seen.stamp + drive.world_offset_s
            blocked.update(self._blocked(seen, place, drive.first))
            passed |= self._passed(place, drive.first)
        return DriveComparison(len(asked), recognised, tuple(self._observed(blocked, passed, stamp)))

    def _observed(self, blocked: Counter[EdgeKey], passed: set[EdgeKey], stamp: float) -> Iterator[PresenceObserved]:
        for key, looks in blocked.items():
            if looks >= _LEAST_LOOKS and key not in passed:
                yield PresenceObserved(*key, present=False, stamp=stamp, cause=Cause.SIGHT)
        for key in passed & self.graph.presence.keys():
            if not self.graph.presence[key][-1].present:
                yield PresenceObserved(*key, present=True, stamp=stamp, cause=Cause.SIGHT)

    def _place(self, seen: Observation, earlier: Sequence[NodeId]) -> _Place | None:
        """Return where an image was taken, as the images themselves and those around them say; None if unsure."""
        held = seen.step in self.keyframes
        features = self.keyframes.features([seen.step]) if held else self.predictor.encode([seen])
        matcher = Matcher(self.predictor, self.keyframes, self.system.method.matching)
        found = matcher.match(features, earlier)
        thresholds = OperatorThresholds.building(self.system.method.building)
        found = found.take(np.argsort(-found.reachability, kind="stable")[:3])
        if held:
            found = LoopClosureVerifier(matcher).connections(seen.step, found, thresholds)
        else:
            found = matcher.with_node_support(found, features)
            found = found.take(found.reachability > thresholds.connect_reachability)
        if not len(found):
            return None
        best = int(found.distances.argmin())
        return _Place(found.nodes[best], invert(found.waypoints[best]))

    def _blocked(self, seen: Observation, place: _Place, first: int) -> list[EdgeKey]:
        camera = self.predictor.camera
        solid = _thinned(transform_points(obstacle_points(seen.depth, camera, _RANGE_M), place.pose))
        mapped = self._mapped(place, first, camera)
        if len(solid) < _LEAST_POINTS or not len(mapped):
            return []
        gaps, _ = KDTree(mapped).query(solid)
        is_new = np.asarray(gaps) > _KNOWN_WITHIN_M
        if is_new.sum() < _LEAST_POINTS or is_new.mean() > 1 - _KNOWN_SHARE:
            return []
        found = Obstruction(node=place.node, points=solid[is_new], known=solid[~is_new], stopped=False)
        return [key for key in edges_obstructed(self.graph, found) if max(key) < first]

    def _mapped(self, place: _Place, first: int, camera: CameraModel) -> NDArray[np.float64]:
        """Return (M, 2) what images of earlier drives show to be solid, in the frame of the place's node."""
        poses = {node: pose for node, pose in nearby_poses(self.graph, place.node).items() if node < first}
        nearest = sorted(poses, key=lambda node: float(np.hypot(*(poses[node] - place.pose)[:2])))[:_NODES]
        points = [
            transform_points(obstacle_points(image.depth, camera, 2 * _RANGE_M), compose(poses[node], pose))
            for node in nearest
            for image, pose in self._around(node)
        ]
        return _thinned(np.concatenate(points)) if points else np.empty((0, 2))

    def _around(self, node: NodeId) -> Iterator[tuple[Observation, Pose]]:
        here = self.keyframes.observation(node).odometry
        for frame in (node, *self.keyframes.temporal_window(node, _IMAGES_AROUND)):
            image = self.keyframes.observation(frame)
            yield image, relative(here, image.odometry)

    def _passed(self, place: _Place, first: int) -> set[EdgeKey]:
        """Return the edges between earlier nodes on the middle of whose way the robot was."""
        poses = nearby_poses(self.graph, place.node)
        near = [(node, target) for node in poses for target in self.graph.successors(node) if max(node, target) < first]
        return {key for key in near if _is_on_way(place.pose, poses[key[0]], np.array(self.graph.edges[key].waypoint))}


def _driven_on(place: _Place, seen: Observation, now: Observation) -> _Place | None:
    """Return where an image was taken that was not recognised, by odometry since the last one that was; None if far."""
    driven = relative(seen.odometry, now.odometry)
    return _Place(place.node, compose(place.pose, driven)) if distance(driven) < _DRIVEN_ON else None


def _is_on_way(robot: Pose, start: Pose, waypoint: Waypoint) -> bool:
    end = compose(start, waypoint)
    middle = [start[:2] + share * (end[:2] - start[:2]) for share in (0.3, 0.7)]
    return bool(distances_to_way(robot[None, :2], middle[0], middle[1])[0] < _ON_WAY_M)


def _spread(observations: Sequence[Observation]) -> list[Observation]:
    """Return images that are apart from each other."""
    kept: list[Observation] = []
    for seen in observations:
        if not kept or distance(relative(kept[-1].odometry, seen.odometry)) >= _ASK_EVERY:
            kept.append(seen)
    return kept


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    _, kept = np.unique(np.round(points / _GRID_M), axis=0, return_index=True)
    return points[kept]
