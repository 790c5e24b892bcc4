"""A map built from a part of a recording: does it hang together, and does it confuse places, by true poses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ltvn_core.analysis.perceptual_aliases import PerceptualAlias, find_perceptual_aliases
from ltvn_core.geometry import distance
from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.deltas import Edge, GraphDelta, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import NO_PRIOR
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.training_data.truth_limits import LIMITS, TrueViews
from ltvn_core.types import Features, FrameId, NodeId, Observation, Pose, Predictor

_MOST_RECOGNISED = 100
"""Images that became no node and are asked which node they show; of more than these, evenly spaced ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapAccuracy:
    """Figures of a map; None where they need truth and there is none."""

    frames: int
    """Images that the map was built from."""
    nodes: int
    edges: int
    pieces: int
    """Strongly connected components of the map,"""
    true_pieces: int | None
    """and the number of parts that the drive itself falls into: groups of images within D_c of each other."""
    largest_piece_share: float
    """Share of the images, those of the largest part of the drive, that are in the map's largest piece or recognised
    as one of its nodes."""
    false_edges: int | None
    """Edges between far images, but for turns on the spot."""
    perceptual_aliases: int | None
    """Pairs of nodes that the method takes for near each other and that are far."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedMap:
    """A map and what it was built from."""

    observations: Sequence[Observation]
    """M images."""
    features: Features
    """(M, F)."""
    views: TrueViews | None
    """Where they were truly taken; None where nobody knows."""
    map: TopologicalMap
    """With all M images."""
    deltas: Sequence[GraphDelta]
    """The map's history."""

    @cached_property
    def matcher(self) -> Matcher:
        """Compares images with those of the map."""
        return Matcher(self.map.predictor, self.map.keyframes, self.map.system.method.matching)

    @cached_property
    def row_of(self) -> Mapping[FrameId, int]:
        """Row of each image."""
        return {seen.step: row for row, seen in enumerate(self.observations)}

    def are_far(self, first: FrameId, second: FrameId) -> bool:
        """Tell whether two images are truly far from each other; only where that is known."""
        assert self.views is not None
        return bool(LIMITS.far(self.views.move(self.row_of[first], self.row_of[second])))

    def is_false(self, edge: Edge) -> bool:
        """Tell whether an edge joins far images; one that says itself that it is a turn on the spot may do so there."""
        assert self.views is not None
        move = self.views.move(self.row_of[edge.source], self.row_of[edge.target])
        turns = abs(edge.waypoint.yaw_rad) > LIMITS.near_rad and np.hypot(move[0], move[1]) < LIMITS.near_m
        return bool(LIMITS.far(move)) and not turns


def build_judged_map(
    observations: Sequence[Observation],
    features: Features,
    views: TrueViews | None,
    *,
    predictor: Predictor,
    system: NavigationSystem,
    rng: np.random.Generator,
    progress: ProgressCallback,
) -> JudgedMap:
    """Build a map from images (M of them) with their features (M, F); raises MapError as the builder does."""
    built = TopologicalMap.of(predictor, system)
    built.keyframes.add(observations, features)
    deltas = built.build(observations, rng=rng, progress=progress)
    built.keyframes.add(observations, features)  # Images that the builder dropped are asked about too.
    return JudgedMap(observations=observations, features=features, views=views, map=built, deltas=deltas)


def map_accuracy(built: JudgedMap, *, progress: ProgressCallback) -> MapAccuracy:
    """Return the figures of a map; `progress` is called with images that were localised and images in all."""
    known = built.views is not None
    pieces = strongly_connected_components(built.map.graph)
    near = built.map.system.method.building.connect_distance
    groups = None if built.views is None else _true_pieces(built.views, near)
    return MapAccuracy(
        frames=len(built.observations),
        nodes=len(built.map.graph.nodes),
        edges=len(built.map.graph.edges),
        pieces=len(pieces),
        true_pieces=None if groups is None else int(groups.max()) + 1,
        largest_piece_share=_share_in(built, set(pieces[0]), groups, progress),
        false_edges=sum(map(built.is_false, built.map.graph.edges.values())) if known else None,
        perceptual_aliases=len(true_aliases(built)) if known else None,
    )


def true_aliases(built: JudgedMap) -> tuple[PerceptualAlias, ...]:
    """Return the pairs of nodes that the method takes for near and that are truly far."""
    assert built.views is not None
    poses = {seen.step: pose for seen, pose in zip(built.observations, built.views.poses, strict=True)}
    keyframes = KeyframeStore(built.map.predictor)
    # The search doubts what odometry contradicts; with true poses in its place it knows.
    keyframes.add([replace(seen, odometry=poses[seen.step]) for seen in built.observations], built.features)
    graph = TopologicalGraph([_at_true_pose(delta, poses) for delta in built.deltas])
    method = built.map.system.method
    found = find_perceptual_aliases(graph, Matcher(built.map.predictor, keyframes, method.matching), method)
    return tuple(pair for pair in found if built.are_far(pair.first, pair.second))


def _at_true_pose(delta: GraphDelta, poses: Mapping[FrameId, Pose]) -> GraphDelta:
    if not isinstance(delta, NodeAdded):
        return delta
    return replace(delta, node=replace(delta.node, odometry=pose_row(poses[delta.node.id])))


def _true_pieces(views: TrueViews, connect_distance: float) -> NDArray[np.intp]:
    """Return for each image (M,) which part of the drive it belongs to, the largest part first."""
    near = distance(views.moves_to(views)) < connect_distance
    _, labels = connected_components(near, directed=False)
    order = np.argsort(-np.bincount(labels), kind="stable")
    return np.argsort(order)[labels]


def _share_in(
    built: JudgedMap, piece: set[NodeId], groups: NDArray[np.intp] | None, progress: ProgressCallback
) -> float:
    """Return the share of the images of the drive's largest part that are in a piece of the map."""
    every = np.arange(len(built.observations)) if groups is None else np.flatnonzero(groups == 0)
    rows: list[int] = every.tolist()
    frames = [built.observations[row].step for row in rows]
    nodes = [frame for frame in frames if frame in built.map.graph.nodes]
    others = [row for row, frame in zip(rows, frames, strict=True) if frame not in built.map.graph.nodes]
    asked = others[:: max(math.ceil(len(others) / _MOST_RECOGNISED), 1)]
    recognised = 0
    for done, row in enumerate(asked, 1):
        recognised += _recognised(built, row) in piece
        progress(len(frames) - len(asked) + done, len(frames))
    share = recognised / len(asked) if asked else 0.0
    return (sum(node in piece for node in nodes) + share * len(others)) / len(frames)


def _recognised(built: JudgedMap, row: int) -> NodeId | None:
    """Return the node that an image of the drive is taken for."""
    return built.map.system.localise(built.features[row : row + 1], built.map.graph, NO_PRIOR, built.matcher).node
