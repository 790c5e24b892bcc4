"""Two rooms that look alike: what a drive passes again tells them apart, and odometry is right afterwards."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ltvn_core.config import ROBUST, Method
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, FrameId, Observation, Pose
from tests.core.flat_world import FlatPredictor, one_room, tour

APART_M = 8.0
ROOM = [(1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0), (1.0, 1.0)]
OTHER_ROOM = [(x + APART_M, y) for x, y in ROOM]
LOOSE = replace(ROBUST, building=replace(ROBUST.building, odometry_drift=0.3))
"""Odometry that is trusted so little that only the closures can tell the rooms apart."""


class AliasedPredictor(FlatPredictor):
    """Takes a place in the one room for the same place in the other, and knows no corridor."""

    def encode(self, observations: Sequence[Observation]) -> Features:
        features = super().encode(observations)
        beyond = np.asarray(features[:, 0], np.float64) > APART_M - 1
        features[:, 0] -= np.where(beyond, APART_M, 0.0)
        return features


@cache
def drive() -> tuple[Observation, ...]:
    """Return a drive round both rooms, twice each, whose odometry turns a little too far."""
    seen = list(tour([*ROOM, *OTHER_ROOM, *ROOM, *OTHER_ROOM[:2]], spins=False))
    truth = np.array([each.odometry for each in seen])
    steps = relative(truth[:-1], truth[1:])
    steps += np.hypot(steps[:, :1], steps[:, 1:2]) * np.array([0.0, 0.0, 0.01])
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return tuple(replace(each, odometry=pose) for each, pose in zip(seen, odometry, strict=True))


def built(method: Method) -> tuple[TopologicalGraph, KeyframeStore]:
    predictor = AliasedPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    deltas = build(drive(), keyframes, predictor, method, np.random.default_rng(0))
    return TopologicalGraph(deltas), keyframes


def false_edges(graph: TopologicalGraph) -> int:
    """Count the edges from one room to the other."""
    x_m = {frame: pose[0] for frame, pose in true_poses().items()}
    return sum(abs(x_m[source] - x_m[target]) > APART_M / 2 for source, target in graph.edges)


def true_poses() -> dict[FrameId, Pose]:
    return {seen.step: seen.exact_pose for seen in drive() if seen.exact_pose is not None}


def worst_error_m(images: Iterable[Observation]) -> float:
    truth = true_poses()
    return max(float(np.hypot(*(seen.odometry - truth[seen.step])[:2])) for seen in images)


def test_rooms_that_look_alike_are_told_apart_by_what_the_drive_passes_again() -> None:
    without, _ = built(replace(LOOSE, building=replace(LOOSE.building, close_loops=False)))
    graph, keyframes = built(LOOSE)
    assert false_edges(without) > 0
    assert false_edges(graph) == 0
    corrected = [keyframes.observation(frame) for frame in keyframes.frames]
    assert worst_error_m(corrected) < 0.6 < worst_error_m(drive())


def test_a_drive_that_passes_nothing_again_keeps_its_odometry() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    build(images, keyframes, predictor, ROBUST, np.random.default_rng(0))
    kept = {seen.step: seen.odometry for seen in images}
    assert all(np.array_equal(keyframes.observation(frame).odometry, kept[frame]) for frame in keyframes.frames)
