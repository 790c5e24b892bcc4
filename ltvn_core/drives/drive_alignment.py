"""Drives in one picture: each is moved as a whole so that it lies where the images say, for drawing.

What odometry knows of two images of one drive stays the same, and of two drives it says no more than before. Owns how a
drive is moved. A drive that was recognised nowhere is put beside the others.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.drives.joined_drives import JoinedDrive
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, Observation, Pose, Predictor

_APART_M = 2.0
_OUTLIER = 3.0
"""What is off by more than this d counts as this much."""

Movements = dict[str, Callable[[Pose], Pose]]


def drive_movements(graph: TopologicalGraph, drives: Sequence[JoinedDrive]) -> Movements:
    """Return by the name of each drive what moves a pose (3,) of its odometry into the frame of the first.

    Linear in edges, and quadratic in those that join drives.
    """
    poses = {node: np.array(held.odometry) for node, held in graph.nodes.items()}
    offsets = {drives[0].name: np.zeros(3)}
    for _ in drives:  # A drive may hang on one that hangs on another.
        for drive in drives:
            opinions = [] if drive.name in offsets else _opinions(graph, drive, drives, poses, offsets)
            if opinions:
                offsets[drive.name] = _most_agreed(np.array(opinions))
    for drive in drives:
        if drive.name not in offsets:
            offsets[drive.name] = _beside(drive, drives, poses, offsets)
    return {name: _mover(offset) for name, offset in offsets.items()}


def _mover(offset: Pose) -> Callable[[Pose], Pose]:
    return lambda pose: compose(offset, pose)


def _opinions(
    graph: TopologicalGraph,
    drive: JoinedDrive,
    drives: Sequence[JoinedDrive],
    poses: dict[FrameId, Pose],
    offsets: dict[str, Pose],
) -> list[Pose]:
    """Return where the beginning of a drive's odometry lies by each edge to a drive whose place is known."""
    placed = [other for other in drives if other.name in offsets]
    found = []
    for (source, target), edge in graph.edges.items():
        other = next((each for each in placed if each.holds(source)), None)
        if other is not None and drive.holds(target):
            there = compose(compose(offsets[other.name], poses[source]), np.array(edge.waypoint))
            found.append(compose(there, invert(poses[target])))
    return found


def _most_agreed(opinions: Pose) -> Pose:
    """Return of opinions (N, 3) the one that is nearest to all others, but for outliers."""
    gaps = distance(relative(opinions[:, None], opinions[None]))
    return opinions[int(np.minimum(gaps, _OUTLIER).sum(axis=1).argmin())]


def _beside(
    drive: JoinedDrive, drives: Sequence[JoinedDrive], poses: dict[FrameId, Pose], offsets: dict[str, Pose]
) -> Pose:
    placed = [
        compose(offsets[other.name], pose)
        for other in drives
        for node, pose in poses.items()
        if other.name in offsets and other.holds(node)
    ]
    own = [pose for node, pose in poses.items() if drive.holds(node)]
    if not placed or not own:
        return np.zeros(3)
    gap = max(pose[0] for pose in placed) + _APART_M - min(pose[0] for pose in own)
    return np.array([gap, 0.0, 0.0])


def moved_observation(seen: Observation, drives: Sequence[JoinedDrive], movements: Movements) -> Observation:
    """Return an image where the movement of its drive puts it."""
    drive = next((each for each in drives if each.holds(seen.step)), None)
    return seen if drive is None else replace(seen, odometry=movements[drive.name](seen.odometry))


def moved_graph(graph: TopologicalGraph, keyframes: KeyframeStore) -> TopologicalGraph:
    """Return the same map with its nodes where `keyframes` has their images."""
    moved = []
    for delta in graph.deltas():
        if isinstance(delta, NodeAdded):
            place = pose_row(keyframes.observation(delta.node.id).odometry)
            delta = replace(delta, node=replace(delta.node, odometry=place))
        moved.append(delta)
    return TopologicalGraph(moved)


def moved_keyframes(
    keyframes: KeyframeStore, predictor: Predictor, drives: Sequence[JoinedDrive], movements: Movements
) -> KeyframeStore:
    """Return the same images with their features, moved."""
    moved = KeyframeStore(predictor)
    moved.begin_drives(keyframes.drive_starts)
    seen = [moved_observation(keyframes.observation(frame), drives, movements) for frame in keyframes.frames]
    if seen:
        moved.add(seen, keyframes.features([each.step for each in seen]))
    return moved
