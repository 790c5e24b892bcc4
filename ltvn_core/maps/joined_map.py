"""Completes a map that was built from several drives: marks where drives begin, finds what later drives contradict, and
aligns the drives.

Owns the order of these steps and the report of each drive. Also owns what a later drive contradicts in the map of
earlier drives: paths that are blocked now, or open again. A point in a depth image is new if no image of the earlier
drives shows a solid point there; `graph.presence.obstruction` finds the edges that new points close.
`graph.drive_links` joins drives while the map is built.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_points import obstacle_points, transform_points
from ltvn_core.findings import Finding
from ltvn_core.geometry import agree, compose, distance, invert, relative
from ltvn_core.graph import loop_closures
from ltvn_core.graph.deltas import Cause, DriveBegun, PresenceObserved
from ltvn_core.graph.free_floor import thinned
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import connectable
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed, nearby_poses
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.maps.drive_alignment import drive_movements, moved_graph, moved_keyframes
from ltvn_core.maps.joined_drives import JoinedDrive
from ltvn_core.maps.map_coverage import evenly
from ltvn_core.types import Features, FrameId, NodeId, Observation, Pose, Predictor

_FEW_RECOGNISED = 0.1
"""Share of recognised images below which a drive is joined to the map by too little."""
_RANGE_M = 2.5
"""Range up to which depth locates obstacles well enough, in metres."""
_KNOWN_WITHIN_M = 0.18
"""Distance to a point in an earlier image within which a point counts as known, in metres."""
_KNOWN_SHARE = 0.5
"""Share of known surroundings below which an image was probably taken elsewhere."""
_LEAST_POINTS = 8
_NODES, _IMAGES_AROUND = 12, 3
"""Number of earlier nodes, and of images before and after each node, that show the known obstacles."""
_GRID_M = 0.05
_ASK_EVERY = 0.35
"""Least d between two images of a drive that are both compared with the map."""
_DRIVEN_ON = 2.5
"""Greatest d over which odometry locates an image after another that was recognised."""
_MOST_LOOKS = 40
"""Largest number of images of a drive that are compared with all nodes while its place is not known."""
_NEAR_NODES = 6
"""Number of nodes that an image of a known place is compared with, the nearest ones."""
_DRIFT = (0.8, 0.6)
"""Largest error of odometry over `_DRIVEN_ON` together with that of a waypoint, in m and rad."""
_LEAST_LOOKS = 2
"""Least number of images that must agree that an edge is blocked."""
_NO_LENGTH = 1e-9
_ON_WAY_M = 0.25
"""Distance from the middle of an edge within which a robot drove along it, in metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveReport:
    """Report of one drive in the map."""

    name: str
    first: int
    """Frame id of its first image in the map."""
    added_steps: int
    """Number that was added to the steps of its recording."""
    nodes: int
    joined_by: int
    """Number of edges between its nodes and those of the drives before; 0 for the first."""
    joined_by_odometry: int
    """Number of these edges that only odometry supports."""
    continues: str
    """Name of the drive before it whose odometry it continues; empty if its odometry restarts."""
    recognised: float | None
    """Share of its images that were recognised in the drives before; None for the first."""
    blocked: tuple[EdgeKey, ...]
    """Edges of earlier drives that this drive saw blocked."""
    returned: tuple[EdgeKey, ...]
    """Edges of earlier drives that were blocked before and that this drive found open."""

    @property
    def is_piece_of_its_own(self) -> bool:
        """Whether no image of it was recognised in the drives before, so that nothing joins it to them."""
        return self.recognised is not None and not self.joined_by and not self.recognised

    def __str__(self) -> str:
        if self.recognised is None:
            return f"{self.name}: {self.nodes} nodes"
        joined = f"{self.recognised:.0%} recognised, joined by {self.joined_by} edges"
        seen = f"{len(self.blocked)} edges seen blocked, {len(self.returned)} open again"
        return f"{self.name}: {self.nodes} new nodes, images from {self.first} on, {joined}; {seen}{self._continued}"

    @property
    def _continued(self) -> str:
        if not self.continues:
            return ""
        by_images = self.joined_by - self.joined_by_odometry
        by = [name for name, count in (("images", by_images), ("odometry", self.joined_by_odometry)) if count]
        joined = f"joined by {' and '.join(by)}" if by else "no edge joins them"
        return f"; {self.name} continues {self.continues}: {joined}"


class JoinedMap(NamedTuple):
    """A map of several drives."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    reports: tuple[DriveReport, ...]


def join_map(
    graph: TopologicalGraph,
    keyframes: KeyframeStore,
    observations: Sequence[Observation],
    drives: Sequence[JoinedDrive],
    predictor: Predictor,
    system: NavigationSystem,
) -> JoinedMap:
    """Return the map that was built from `observations`, completed with its drives.

    The `observations` are as the predictor sees them. Each drive after the first is compared with those before it; see
    `_Contradictions.compare` for the cost.
    """
    for drive in drives:
        graph.apply(DriveBegun(drive.first, drive.name, Cause.BUILD))
    contradictions = _Contradictions(graph, keyframes, predictor, system)
    reports = [_report(graph, drives[0], None)]
    for drive in drives[1:]:
        own = sorted((seen for seen in observations if drive.holds(seen.step)), key=lambda seen: seen.step)
        comparison = contradictions.compare(own, drive)
        for delta in comparison.observed:
            graph.apply(delta)
        reports.append(_report(graph, drive, comparison))
    movements = drive_movements(graph, drives)
    moved = moved_keyframes(keyframes, predictor, drives, movements)
    return JoinedMap(moved_graph(graph, moved), moved, tuple(reports))


def drive_findings(reports: Sequence[DriveReport]) -> Iterator[Finding]:
    """Yield findings about drives that hardly meet, with advice."""
    for report in reports[1:]:
        if report.is_piece_of_its_own:
            yield Finding(
                f"No image of {report.name} was recognised in the drives before it: its {report.nodes} nodes are a "
                "separate piece, and no path leads there.",
                remedy="Drive through a place of both drives, in the same direction, or try another --predictor.",
                where=report.name,
            )
        elif not report.joined_by and report.nodes:
            yield Finding(
                f"No edge joins {report.name} to the drives before it, though {report.recognised:.0%} of its images "
                "look like places there.",
                remedy="Drive more slowly where both drives were, or try another --predictor.",
                where=report.name,
            )
        elif report.recognised is not None and report.recognised < _FEW_RECOGNISED and not report.continues:
            text = f"Only {report.recognised:.0%} of {report.name} was recognised in the drives before it."
            yield Finding(text, where=report.name)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where an image of a later drive was taken."""

    node: NodeId
    """A node of an earlier drive."""
    pose: Pose
    """The robot's pose (3,) in the node's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """Result of comparing a later drive with the map of earlier ones."""

    asked: int
    """Number of images that were compared with the map."""
    recognised: int
    """Number of compared images whose place was recognised."""
    observed: tuple[PresenceObserved, ...]
    """Edges that the drive saw blocked, or found open that had been blocked."""

    @property
    def share(self) -> float:
        """Share of the compared images whose place was recognised."""
        return self.recognised / self.asked if self.asked else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Contradictions:
    """Compares later drives with the map of earlier ones."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    predictor: Predictor
    system: NavigationSystem
    points: dict[FrameId, NDArray[np.float64]] = field(default_factory=dict[FrameId, NDArray[np.float64]])
    """Solid points of images of earlier drives."""

    def compare(self, observations: Sequence[Observation], drive: JoinedDrive) -> _Comparison:
        """Compare the images of a drive, in order, with the nodes of those before.

        After a recognised image, the next ones are compared only with the nodes near it. Where the place is not known,
        a limited number of images is compared with all nodes.
        """
        earlier = [node for node in self.graph.nodes if node < drive.first]
        images = _spread(observations) if earlier else []
        looks = {seen.step for seen in evenly(images, _MOST_LOOKS)}
        asked = 0
        blocked = Counter[EdgeKey]()
        passed = set[EdgeKey]()
        stamp = 0.0
        recognised = 0
        last: tuple[_Place, Observation] | None = None
        for seen in images:
            driven = None if last is None else _driven_on(*last, seen)
            if driven is None and seen.step not in looks:
                continue
            asked += 1
            place = self._place(seen, earlier) if driven is None else self._near_place(seen, driven, drive.first)
            if place is not None:
                recognised += 1
                last = place, seen
            elif driven is not None:
                place = driven
            else:
                continue
            stamp = seen.stamp + drive.world_offset_s
            blocked.update(self._blocked(seen, place, drive.first))
            passed |= self._passed(place, drive.first)
        return _Comparison(asked, recognised, tuple(self._observed(blocked, passed, stamp)))

    def _observed(self, blocked: Counter[EdgeKey], passed: set[EdgeKey], stamp: float) -> Iterator[PresenceObserved]:
        for key, looks in blocked.items():
            if looks >= _LEAST_LOOKS and key not in passed:
                yield PresenceObserved(*key, present=False, stamp=stamp, cause=Cause.SIGHT)
        for key in passed & self.graph.presence.keys():
            if not self.graph.presence[key][-1].present:
                yield PresenceObserved(*key, present=True, stamp=stamp, cause=Cause.SIGHT)

    def _place(self, seen: Observation, earlier: Sequence[NodeId]) -> _Place | None:
        """Return where an image was taken, judged by the image and those near it in time; None if unsure."""
        held = seen.step in self.keyframes
        features = self._features(seen)
        matcher = self._matcher
        found = matcher.match(features, earlier)
        thresholds = self.system.method.building
        found = found.take(np.argsort(-found.reachability, kind="stable")[:3])
        if held:
            found = loop_closures.connections(seen.step, found, matcher, thresholds)
        else:
            found = matcher.with_node_support(found, features)
            found = found.take(found.reachability > thresholds.connect_reachability)
        if not len(found):
            return None
        best = int(found.distances.argmin())
        return _Place(found.nodes[best], invert(found.waypoints[best]))

    def _near_place(self, seen: Observation, driven: _Place, first: int) -> _Place | None:
        """Return where an image was taken by the images near the place to which odometry leads since the last
        recognised one; None if none of them confirms it."""
        poses = {node: pose for node, pose in nearby_poses(self.graph, driven.node).items() if node < first}
        nodes = sorted(poses, key=lambda node: float(distance(relative(driven.pose, poses[node]))))[:_NEAR_NODES]
        found = self._matcher.match(self._features(seen), nodes)
        found = found.take(connectable(found, self.system.method.building))
        expected = relative(driven.pose, np.array([poses[node] for node in found.nodes]).reshape(-1, 3))
        found = found.take(agree(expected, found.waypoints, _DRIFT))
        if not len(found):
            return None
        best = int(found.distances.argmin())
        return _Place(found.nodes[best], invert(found.waypoints[best]))

    def _features(self, seen: Observation) -> Features:
        return self.keyframes.features([seen.step]) if seen.step in self.keyframes else self.predictor.encode([seen])

    @property
    def _matcher(self) -> Matcher:
        return Matcher(self.predictor, self.keyframes, self.system.method.matching)

    def _blocked(self, seen: Observation, place: _Place, first: int) -> list[EdgeKey]:
        camera = self.predictor.camera
        solid = thinned(transform_points(self._obstacles(seen, camera, _RANGE_M), place.pose), _GRID_M)
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
        """Return (M, 2) solid points in images of earlier drives, in the frame of the place's node."""
        poses = {node: pose for node, pose in nearby_poses(self.graph, place.node).items() if node < first}
        nearest = sorted(poses, key=lambda node: float(np.hypot(*(poses[node] - place.pose)[:2])))[:_NODES]
        points = [
            transform_points(self._solid(image, camera), compose(poses[node], pose))
            for node in nearest
            for image, pose in self._around(node)
        ]
        return thinned(np.concatenate(points), _GRID_M) if points else np.empty((0, 2))

    def _solid(self, image: Observation, camera: CameraModel) -> NDArray[np.float64]:
        """Return the solid points (M, 2) of an image of an earlier drive, which many images of later ones ask for."""
        if image.step not in self.points:
            self.points[image.step] = self._obstacles(image, camera, 2 * _RANGE_M)
        return self.points[image.step]

    def _obstacles(self, image: Observation, camera: CameraModel, range_m: float) -> NDArray[np.float64]:
        height_m = self.keyframes.needed_space(camera).height_m
        return obstacle_points(image.depth, camera, range_m, height_m=height_m)

    def _around(self, node: NodeId) -> Iterator[tuple[Observation, Pose]]:
        here = self.keyframes.observation(node).odometry
        for frame in (node, *self.keyframes.temporal_window(node, _IMAGES_AROUND)):
            image = self.keyframes.observation(frame)
            yield image, relative(here, image.odometry)

    def _passed(self, place: _Place, first: int) -> set[EdgeKey]:
        """Return the edges between earlier nodes whose middle the robot passed."""
        poses = nearby_poses(self.graph, place.node)
        near = [(node, target) for node in poses for target in self.graph.successors(node) if max(node, target) < first]
        if not near:
            return set()
        starts = np.array([poses[source] for source, _ in near])
        ends = compose(starts, np.array([self.graph.edges[key].waypoint for key in near]))
        ways = ends[:, :2] - starts[:, :2]
        # The middle of a way is from 0.3 to 0.7 of it.
        along = ((place.pose[:2] - starts[:, :2]) * ways).sum(axis=1) / np.maximum((ways**2).sum(axis=1), _NO_LENGTH)
        beside = starts[:, :2] + np.clip(along, 0.3, 0.7)[:, None] * ways - place.pose[:2]
        return {key for key, is_on in zip(near, np.hypot(*beside.T) < _ON_WAY_M, strict=True) if is_on}


def _report(graph: TopologicalGraph, drive: JoinedDrive, comparison: _Comparison | None) -> DriveReport:
    """Return the report of a drive from its `comparison` with the drives before, which is None for the first drive.

    Linear in the map.
    """
    crossing = [
        edge
        for key, edge in graph.edges.items()
        if drive.holds(key[0]) != drive.holds(key[1]) and max(key) <= drive.last
    ]
    observed = () if comparison is None else comparison.observed
    return DriveReport(
        name=drive.name,
        first=drive.first,
        added_steps=drive.added_steps,
        nodes=sum(drive.holds(node) for node in graph.nodes),
        joined_by=len(crossing),
        joined_by_odometry=sum(edge.by_odometry for edge in crossing),
        continues=drive.continues,
        recognised=None if comparison is None else round(comparison.share, 3),
        blocked=tuple((each.source, each.target) for each in observed if not each.present),
        returned=tuple((each.source, each.target) for each in observed if each.present),
    )


def _driven_on(place: _Place, seen: Observation, now: Observation) -> _Place | None:
    """Return where an image that was not recognised was taken, by odometry since the last recognised one; None if
    far."""
    driven = relative(seen.odometry, now.odometry)
    return _Place(place.node, compose(place.pose, driven)) if distance(driven) < _DRIVEN_ON else None


def _spread(observations: Sequence[Observation]) -> list[Observation]:
    """Return images that are apart from each other by at least `_ASK_EVERY`."""
    kept: list[Observation] = []
    for seen in observations:
        if not kept or distance(relative(kept[-1].odometry, seen.odometry)) >= _ASK_EVERY:
            kept.append(seen)
    return kept
