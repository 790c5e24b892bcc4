"""While somebody drives: merge, connect or keep, with the same operators."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.graph.deltas import Cause, FramesReleased, GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import OnlineBuilder, reachable_nodes
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour

ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 3.2), (0.7, 0.7)]


def driven(
    images: Iterable[Observation], method: Method = ROBUST, limit: int = 2000, sight_m: float = 2.0
) -> tuple[TopologicalGraph, KeyframeStore, list[GraphDelta]]:
    graph, predictor, history = TopologicalGraph(), FlatPredictor(one_room(), sight_m=sight_m), []
    keyframes = KeyframeStore(predictor)
    online = OnlineBuilder(graph, keyframes, predictor, method, reserve_limit=limit)
    for seen in images:
        for delta in online.offer(seen):
            graph.apply(delta)
            history.append(delta)
    return graph, keyframes, history


def test_the_map_grows_in_one_piece_and_is_the_fold_of_what_was_told() -> None:
    images = list(tour(ROUND))
    graph, keyframes, history = driven(images)
    assert 10 < len(graph.nodes) < len(images) / 2
    assert reachable_nodes(graph, images[0].step) == set(graph.nodes)
    assert TopologicalGraph(history) == graph
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)


def test_the_first_image_is_a_node_and_the_same_image_again_changes_nothing() -> None:
    seen = observation_at(np.array([1.0, 1.0, 0.0]), 5)
    graph, _, history = driven([seen, seen])
    assert list(graph.nodes) == [5]
    assert len(history) == 1


def test_a_near_sighted_predictor_joins_images_by_way_of_merged_ones() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    graph, keyframes, history = driven(images, sight_m=0.4)
    assert np.ptp([node.odometry.x_m for node in graph.nodes.values()]) > 2.8
    assert reachable_nodes(graph, images[0].step) == set(graph.nodes)
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)
    assert TopologicalGraph(history) == graph
    without = replace(ROBUST, building=replace(ROBUST.building, bridges=False))
    assert len(driven(images, without, sight_m=0.4)[0].nodes) < 3


def test_standing_still_adds_no_nodes() -> None:
    graph, _, _ = driven(observation_at(np.array([1.0, 1.0, 0.0]), step) for step in range(20))
    assert len(graph.nodes) == 1


def test_the_reserve_is_bounded_and_its_oldest_images_go() -> None:
    graph, keyframes, _ = driven(tour(ROUND), limit=25)
    assert len(graph.reserve) == 25
    assert len(keyframes) == len(graph.nodes) + 25


def test_the_literal_method_forgets_merged_images() -> None:
    graph, keyframes, _ = driven(tour(ROUND), method=PAPER)
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)
    assert not graph.reserve


def test_an_image_without_neighbours_waits_until_one_comes() -> None:
    start, far = observation_at(np.array([0.7, 0.7, 0.0]), 0), observation_at(np.array([3.5, 0.7, 0.0]), 1)
    between = [observation_at(np.array([x, 0.7, 0.0]), step) for step, x in enumerate((1.4, 2.1, 2.8), 2)]
    graph, _, _ = driven([start, far])
    assert list(graph.reserve) == [1]
    graph, _, _ = driven([start, far, *between])
    assert set(graph.nodes) == {0, 1, 2, 3, 4}
    assert not graph.reserve


def test_an_image_that_navigation_took_out_of_the_reserve_is_left_alone() -> None:
    graph, predictor = TopologicalGraph(), FlatPredictor(one_room())
    online = OnlineBuilder(graph, KeyframeStore(predictor), predictor, ROBUST)
    places = ((0, 0.7), (1, 3.5), (2, 1.4), (3, 2.1), (4, 2.8))
    for step, x in places:
        for delta in online.offer(observation_at(np.array([x, 0.7, 0.0]), step)):
            graph.apply(delta)
        if step == 1:
            graph.apply(FramesReleased((1,), Cause.EXPAND))
    assert set(graph.nodes) == {0, 2, 3, 4}
