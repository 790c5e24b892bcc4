"""When there is no path, the reserve gives one, and only what lies on it stays."""

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.graph.deltas import Cause, EdgePruned, FramesReleased, FramesReserved, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import NEIGHBOURS, SAMPLES, expand
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import bidirectional_edges, node_from_observation
from ltvn_core.graph.planner import Planner, reachable_nodes
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId
from tests.core.flat_world import FlatPredictor, observation_at, one_room

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
IMAGES = [observation_at(np.array([0.4 + 0.1 * k, 1.0, 0.0]), 10 * k) for k in range(42)]
ENDS = (0, 60, 120, 280, 340, 400)
"""Nodes with a hole in the middle; they are 0.6 m apart, 1.6 m at the hole."""


def cut_map(predictor: FlatPredictor, method: Method) -> tuple[TopologicalGraph, Matcher]:
    keyframes = KeyframeStore(predictor)
    keyframes.add(IMAGES)
    matcher = Matcher(predictor, keyframes, method.matching)
    graph = TopologicalGraph(
        NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in IMAGES if seen.step in ENDS
    )
    for source, target in ((0, 60), (60, 120), (280, 340), (340, 400)):
        for delta in bidirectional_edges(
            source, matcher.match(keyframes.features([source]), (target,)), method.believing, Cause.BUILD
        ):
            graph.apply(delta)
    left = tuple(seen.step for seen in IMAGES if seen.step not in ENDS)
    graph.apply(FramesReserved(left, Cause.BUILD))
    return graph, matcher


def expanded(graph: TopologicalGraph, matcher: Matcher, method: Method, goal: FrameId = 400) -> TopologicalGraph:
    before = graph.copy()
    deltas = expand(graph, 0, goal, matcher, method, np.random.default_rng(0))
    assert graph == before  # A search changes nothing by itself.
    for delta in deltas:
        graph.apply(delta)
    return graph


@PRESETS
def test_a_cut_map_is_joined_again_by_the_images_between(method: Method) -> None:
    graph, matcher = cut_map(FlatPredictor(one_room()), method)
    assert not Planner(graph, method.planning).plan(0, 400).nodes
    expanded(graph, matcher, method)
    path = Planner(graph, method.planning).plan(0, 400)
    assert path.nodes[0] == 0
    assert path.nodes[-1] == 400
    new = set(graph.nodes) - set(ENDS)
    assert new
    assert new <= set(path.nodes)
    assert not new & set(graph.reserve)


def test_the_robust_search_finds_the_hole_at_once() -> None:
    graph, matcher = cut_map(FlatPredictor(one_room()), ROBUST)
    expanded(graph, matcher, ROBUST)
    new = set(graph.nodes) - set(ENDS)
    assert len(new) <= 2
    assert all(120 < frame < 280 for frame in new)


@PRESETS
def test_where_nothing_fits_nothing_changes(method: Method) -> None:
    predictor = FlatPredictor(one_room(), sight_m=0.05)
    graph, matcher = cut_map(predictor, method)
    assert expanded(graph.copy(), matcher, method) == graph


def test_a_false_bridge_does_not_fool_the_robust_search() -> None:
    lies = {(frame, node): np.array([0.5, 0.0, 0.0]) for frame in (50,) for node in (280, 340)}
    predictor = FlatPredictor(one_room(), lies=lies)
    graph, matcher = cut_map(predictor, ROBUST)
    expanded(graph, matcher, ROBUST)
    assert 50 not in graph.nodes
    assert Planner(graph, ROBUST.planning).plan(0, 400).nodes


@PRESETS
def test_an_empty_reserve_or_a_foreign_goal_gives_nothing(method: Method) -> None:
    graph, matcher = cut_map(FlatPredictor(one_room()), method)
    assert expand(graph, 0, 999, matcher, method, np.random.default_rng(0)) == ()
    graph.apply(FramesReleased(tuple(graph.reserve), Cause.HAND))
    assert expand(graph, 0, 400, matcher, method, np.random.default_rng(0)) == ()


def test_the_robust_search_does_bounded_work() -> None:
    predictor = FlatPredictor(one_room(), sight_m=0.05)
    graph, matcher = cut_map(predictor, ROBUST)
    predictor.compared = 0
    expand(graph, 0, 400, matcher, ROBUST, np.random.default_rng(0))
    assert predictor.compared <= 2 * SAMPLES * NEIGHBOURS


def test_what_is_reached_follows_the_edges_one_way_and_back() -> None:
    graph, _ = cut_map(FlatPredictor(one_room()), ROBUST)
    assert reachable_nodes(graph, 0) == {0, 60, 120}
    assert reachable_nodes(graph, 400, backwards=True) == {280, 340, 400}
    graph.apply(EdgePruned(60, 120, Cause.HAND))
    assert reachable_nodes(graph, 0) == {0, 60}
    assert reachable_nodes(graph, 0, backwards=True) == {0, 60, 120}
