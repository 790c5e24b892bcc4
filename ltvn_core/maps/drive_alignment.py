"""Aligns drives for drawing: moves each drive as a whole to where its recognised images place it.

The relative poses within a drive do not change. Drives with continued odometry are moved together, and a drive without
recognised images is placed beside the others. Owns how a drive is moved.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.joined_drives import JoinedDrive
from ltvn_core.types import FrameId, Observation, Pose, Predictor

_APART_M = 2.0
_OUTLIER = 3.0
"""Greatest d of an error; the larger errors of outliers count as this."""

Movements = dict[str, Callable[[Pose], Pose]]


def drive_movements(graph: TopologicalGraph, drives: Sequence[JoinedDrive]) -> Movements:
    """Return for each drive, by name, the transform of its odometry poses (3,) into the frame of the first drive.

    Linear in the number of edges, and quadratic in the number of edges that join drives.
    """
    poses = {node: np.array(held.odometry) for node, held in graph.nodes.items()}
    groups = _groups(drives)
    offsets = {drive.name: np.zeros(3) for drive in groups[0]}
    for _ in groups:  # A drive may be joined only to a drive that must be placed first.
        for group in groups:
            opinions = [] if group[0].name in offsets else _opinions(graph, group, drives, poses, offsets)
            if opinions:
                offsets |= dict.fromkeys((drive.name for drive in group), _most_agreed(np.array(opinions)))
    for group in groups:
        if group[0].name not in offsets:
            offsets |= dict.fromkeys((drive.name for drive in group), _beside(group, drives, poses, offsets))
    return {name: _mover(offset) for name, offset in offsets.items()}


_Group: TypeAlias = list[JoinedDrive]
"""Drives that share one odometry, so that they are moved together."""


def _groups(drives: Sequence[JoinedDrive]) -> list[_Group]:
    groups = list[_Group]()
    for drive in drives:
        if groups and drive.continues:
            groups[-1].append(drive)
        else:
            groups.append([drive])
    return groups


def _mover(offset: Pose) -> Callable[[Pose], Pose]:
    return lambda pose: compose(offset, pose)


def _opinions(
    graph: TopologicalGraph,
    group: _Group,
    drives: Sequence[JoinedDrive],
    poses: dict[FrameId, Pose],
    offsets: dict[str, Pose],
) -> list[Pose]:
    """Return the origins (3,) of a group's odometry, one from each edge to a drive that is already placed."""
    placed = [other for other in drives if other.name in offsets]
    found = []
    for (source, target), edge in graph.driven_edges.items():
        other = next((each for each in placed if each.holds(source)), None)
        if other is not None and any(drive.holds(target) for drive in group):
            there = compose(compose(offsets[other.name], poses[source]), np.array(edge.waypoint))
            found.append(compose(there, invert(poses[target])))
    return found


def _most_agreed(opinions: Pose) -> Pose:
    """Return the origin among (N, 3) that is nearest to all others, with outliers capped."""
    gaps = distance(relative(opinions[:, None], opinions[None]))
    return opinions[int(np.minimum(gaps, _OUTLIER).sum(axis=1).argmin())]


def _beside(group: _Group, drives: Sequence[JoinedDrive], poses: dict[FrameId, Pose], offsets: dict[str, Pose]) -> Pose:
    placed = [
        compose(offsets[other.name], pose)
        for other in drives
        for node, pose in poses.items()
        if other.name in offsets and other.holds(node)
    ]
    own = [pose for node, pose in poses.items() if any(drive.holds(node) for drive in group)]
    if not placed or not own:
        return np.zeros(3)
    gap = max(pose[0] for pose in placed) + _APART_M - min(pose[0] for pose in own)
    return np.array([gap, 0.0, 0.0])


def moved_observation(seen: Observation, drives: Sequence[JoinedDrive], movements: Movements) -> Observation:
    """Return an image, moved together with its drive."""
    drive = next((each for each in drives if each.holds(seen.step)), None)
    return seen if drive is None else replace(seen, odometry=movements[drive.name](seen.odometry))


def moved_graph(graph: TopologicalGraph, keyframes: KeyframeStore) -> TopologicalGraph:
    """Return the same map, with its nodes at the poses of their images in `keyframes`."""
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
    """Return the same images and features, with moved poses."""
    moved = KeyframeStore(predictor)
    moved.begin_drives(keyframes.drive_starts, resumed=keyframes.resumed_starts)
    moved.space = keyframes.space
    seen = [moved_observation(keyframes.observation(frame), drives, movements) for frame in keyframes.frames]
    if seen:
        moved.add(seen, keyframes.features([each.step for each in seen]))
    return moved
