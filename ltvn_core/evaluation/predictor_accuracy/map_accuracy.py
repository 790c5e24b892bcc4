"""Accuracy of a map built from a part of a recording, by true poses: its connectivity, and localisation in it.

The other images are localised in the map: the share that is localised, the errors, and the share at a wrong place.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ltvn_core.analysis.localisation_confidence import PerceptualAlias, find_perceptual_aliases
from ltvn_core.evaluation.edge_accuracy import misplaced, waypoint_errors
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import GraphDelta, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import NO_PRIOR
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.network.metrics import or_none, quantile
from ltvn_core.training.drive_path import LIMITS, TrueViews
from ltvn_core.types import Features, FrameId, NodeId, Observation, Pose, Predictor

_MOST_RECOGNISED = 100
"""Maximum number of images without a node that are localised in the map, evenly spaced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapAccuracy:
    """Figures of a map; figures that need truth are None without truth."""

    frames: int
    """Number of images that the map was built from."""
    nodes: int
    edges: int
    pieces: int
    """Number of strongly connected components of the map."""
    true_pieces: int | None
    """Number of parts of the drive itself: groups of images within D_c of each other."""
    largest_piece_share: float
    """Share of the images of the drive's largest part that are nodes in the map's largest piece or localised at one of
    its nodes."""
    false_edges: int | None
    """Number of edges that lead elsewhere: more than 0.5 m or 20 degrees from where their waypoint says, however long
    they are."""
    edge_error_median_m: float | None
    """Median distance of the ends of the edges from where their waypoints say, in metres; None also without edges."""
    edge_error_p90_m: float | None
    perceptual_aliases: int | None
    """Number of pairs of nodes that are far apart but that the method accepts as near."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedMap:
    """A map and its images."""

    observations: Sequence[Observation]
    """M images."""
    features: Features
    """(M, F) features of the images."""
    views: TrueViews | None
    """True poses of the images; None if unknown."""
    map: TopologicalMap
    """The map, with all M images."""
    deltas: Sequence[GraphDelta]
    """The map's history."""

    @cached_property
    def matcher(self) -> Matcher:
        """Compares images with the images of the map."""
        return Matcher(self.map.predictor, self.map.keyframes, self.map.system.method.matching)

    @cached_property
    def row_of(self) -> Mapping[FrameId, int]:
        """Row of each image."""
        return {seen.step: row for row, seen in enumerate(self.observations)}


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
    """Build a map from M images with their features (M, F). Raises MapError as the builder does."""
    built = TopologicalMap.of(predictor, system)
    built.keyframes.add(observations, features)
    deltas = built.build(observations, rng=rng, progress=progress)
    built.keyframes.add(observations, features)  # Images that the builder dropped are also compared.
    return JudgedMap(observations=observations, features=features, views=views, map=built, deltas=deltas)


def map_accuracy(built: JudgedMap, *, progress: ProgressCallback) -> MapAccuracy:
    """Return the figures of a map; `progress` is called with the numbers of localised and all images."""
    views = built.views
    known = views is not None
    pieces = strongly_connected_components(built.map.graph)
    near = built.map.system.method.building.connect_distance
    groups = None if views is None else _true_pieces(views, near)
    edges = () if views is None else built.map.graph.driven_edges.values()
    errors = waypoint_errors(edges, {} if views is None else dict(zip(built.row_of, views.poses, strict=True)))
    off_m = np.hypot(errors[:, 0], errors[:, 1])
    return MapAccuracy(
        frames=len(built.observations),
        nodes=len(built.map.graph.nodes),
        edges=len(built.map.graph.edges),
        pieces=len(pieces),
        true_pieces=None if groups is None else int(groups.max()) + 1,
        largest_piece_share=_share_in(built, set(pieces[0]), groups, progress),
        false_edges=int(misplaced(errors).sum()) if known else None,
        edge_error_median_m=or_none(quantile(off_m, 0.5)),
        edge_error_p90_m=or_none(quantile(off_m, 0.9)),
        perceptual_aliases=len(true_aliases(built)) if known else None,
    )


def true_aliases(built: JudgedMap) -> tuple[PerceptualAlias, ...]:
    """Return the pairs of nodes that the method accepts as near although they are far apart."""
    assert built.views is not None
    poses = {seen.step: pose for seen, pose in zip(built.observations, built.views.poses, strict=True)}
    keyframes = KeyframeStore(built.map.predictor)
    # The search rejects pairs that contradict odometry; here true poses replace odometry.
    keyframes.add([replace(seen, odometry=poses[seen.step]) for seen in built.observations], built.features)
    moved = [
        replace(delta, node=replace(delta.node, odometry=pose_row(poses[delta.node.id])))
        if isinstance(delta, NodeAdded)
        else delta
        for delta in built.deltas
    ]
    graph = TopologicalGraph(moved)
    method = built.map.system.method
    found = find_perceptual_aliases(graph, Matcher(built.map.predictor, keyframes, method.matching), method)
    rows = built.row_of
    return tuple(pair for pair in found if LIMITS.far(built.views.move(rows[pair.first], rows[pair.second])))


def _true_pieces(views: TrueViews, connect_distance: float) -> NDArray[np.intp]:
    """Return the part of the drive that each image (M,) belongs to, the largest part first."""
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
        features = built.features[row : row + 1]
        recognised += built.map.system.localise(features, built.map.graph, NO_PRIOR, built.matcher).node in piece
        progress(len(frames) - len(asked) + done, len(frames))
    share = recognised / len(asked) if asked else 0.0
    return (sum(node in piece for node in nodes) + share * len(others)) / len(frames)


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalisationAccuracy:
    """Accuracy of localisation in a map. The four shares add up to 1; they are None without images."""

    looks: int
    """Number of images that were localised in the map."""
    looks_elsewhere: int
    """Number of images left out because the map has no image within D_l of their true poses."""
    localised_share: float | None
    """Share of images localised within 0.5 m and 20 degrees of the truth."""
    wrong_place_share: float | None
    """Share of images localised at a node that is truly far away."""
    inaccurate_share: float | None
    """Share of images localised at a node that is not far, but not within 0.5 m and 20 degrees."""
    lost_share: float | None
    """Share of images localised at no node."""
    position_median_m: float | None
    """Median error of the localised images, in metres."""
    position_p90_m: float | None
    yaw_median_deg: float | None


@dataclass(frozen=True, slots=True)
class _Look:
    pose: Pose | None
    """(3,) pose by the map; None if the image is not localised."""
    is_far: bool
    """Whether the image is localised at a node that is truly far away."""


def localisation_accuracy(
    built: JudgedMap, features: Features, views: TrueViews, *, progress: Callable[[int], object]
) -> LocalisationAccuracy:
    """Localise L images with features (L, F) in a map.

    The estimated pose of an image is computed from the true pose of its node and the predicted waypoint. So only the
    errors of the predictor count, and not those of odometry.

    Args:
        built: A map with true views.
        features: Features of the images.
        views: True poses of the images.
        progress: Called with the number of newly localised images.
    """
    assert built.views is not None
    reach = built.map.system.method.localising.distance
    can: NDArray[np.bool_] = np.any(distance(views.moves_to(built.views)) < reach, axis=1)
    looks = []
    for row in range(len(views)):
        if can[row]:
            looks.append(_look(built, features[row : row + 1], views.take([row])))
        progress(1)
    return _summary(looks, views.take(np.flatnonzero(can)), elsewhere=int((~can).sum()))


def _look(built: JudgedMap, features: Features, view: TrueViews) -> _Look:
    assert built.views is not None
    found = built.map.system.localise(features, built.map.graph, NO_PRIOR, built.matcher)
    if found.node is None:
        return _Look(pose=None, is_far=False)
    row = built.row_of[found.node]
    is_far = bool(LIMITS.far(view.moves_to(built.views.take([row])))[0, 0])
    return _Look(pose=compose(built.views.poses[row], invert(found.waypoint)), is_far=is_far)


def _summary(looks: list[_Look], views: TrueViews, *, elsewhere: int) -> LocalisationAccuracy:
    lost = np.array([look.pose is None for look in looks], bool)
    nowhere = np.full(3, np.nan)
    claimed = np.array([nowhere if look.pose is None else look.pose for look in looks])
    errors = relative(views.poses, claimed.reshape(-1, 3))
    off_m = np.hypot(*errors[:, :2].T)
    off_rad = np.abs(errors[:, 2])
    wrong = np.array([look.is_far for look in looks], bool)
    right = ~lost & ~wrong & ~misplaced(errors)
    return LocalisationAccuracy(
        looks=len(looks),
        looks_elsewhere=elsewhere,
        localised_share=_share(right),
        wrong_place_share=_share(wrong),
        inaccurate_share=_share(~lost & ~wrong & ~right),
        lost_share=_share(lost),
        position_median_m=or_none(quantile(off_m[right], 0.5)),
        position_p90_m=or_none(quantile(off_m[right], 0.9)),
        yaw_median_deg=or_none(float(np.degrees(quantile(off_rad[right], 0.5)))),
    )


def _share(chosen: NDArray[np.bool_]) -> float | None:
    return float(chosen.mean()) if len(chosen) else None
