"""Driving strengthens edges, weakens them, prunes them in time, and adds what nobody knew."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, EdgePruned, Node, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import (
    HINDERED_PRUNE_BELOW,
    AttemptEvidence,
    novel_node,
    update_edge,
)
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.core.flat_world import FlatPredictor, observation_at, one_room

HERE = PoseRow(0.0, 0.0, 0.0)


def one_edge(p: float = 0.8, *, protected: bool = False) -> TopologicalGraph:
    edge = Edge(1, 2, PoseRow(1.0, 0.0, 0.0), Belief(p, 1.0, 0.02), protected=protected)
    nodes = [NodeAdded(Node(frame, HERE), Cause.BUILD) for frame in (1, 2)]
    return TopologicalGraph([*nodes, EdgeAdded(edge, Cause.BUILD)])


def attempt(graph: TopologicalGraph, method: Method, *, succeeded: bool, failed_before: bool = False) -> list[str]:
    """Drive the edge once; return what happened to it."""
    deltas = update_edge(graph, AttemptEvidence(1, 2, 1.2, succeeded, failed_before), method.believing)
    for delta in deltas:
        assert delta.cause is Cause.ATTEMPT
        graph.apply(delta)
    return [type(delta).__name__ for delta in deltas]


def test_a_success_raises_p_and_measures_the_length() -> None:
    graph = one_edge()
    assert attempt(graph, ROBUST, succeeded=True) == ["BeliefUpdated"]
    edge = graph.edges[1, 2]
    assert edge.belief.p > 0.8
    assert edge.belief.mu == pytest.approx(1.1)
    assert (edge.attempts, edge.successes) == (1, 1)


def test_the_literal_method_prunes_at_the_first_failure_below_the_threshold() -> None:
    graph = one_edge(p=0.6)
    assert attempt(graph, PAPER, succeeded=False) == ["BeliefUpdated", "EdgePruned"]
    assert not graph.edges


def test_a_success_never_prunes() -> None:
    assert attempt(one_edge(p=0.05), PAPER, succeeded=True) == ["BeliefUpdated"]


def test_the_robust_method_waits_for_failures_in_three_queries() -> None:
    graph = one_edge(p=0.6)
    for _ in range(2):
        assert attempt(graph, ROBUST, succeeded=False) == ["BeliefUpdated"]
        assert attempt(graph, ROBUST, succeeded=False, failed_before=True) == []
    assert attempt(graph, ROBUST, succeeded=False) == ["BeliefUpdated", "EdgePruned"]


def test_an_edge_that_was_driven_once_needs_more_failures_to_leave() -> None:
    graph = one_edge(p=0.6)
    attempt(graph, ROBUST, succeeded=True)
    for _ in range(4):
        assert attempt(graph, ROBUST, succeeded=False) == ["BeliefUpdated"]
    assert graph.edges[1, 2].belief.p < 0.05
    assert attempt(graph, ROBUST, succeeded=False) == ["BeliefUpdated", "EdgePruned"]


def test_an_edge_that_has_left_the_map_is_not_updated() -> None:
    graph = one_edge()
    graph.apply(EdgePruned(1, 2, Cause.HAND))
    assert attempt(graph, ROBUST, succeeded=True) == []


HERE_IT_IS = observation_at(np.array([1.0, 1.0, 0.0]), 50)


def novel(graph: TopologicalGraph, x: float, method: Method = ROBUST) -> Sequence[object]:
    """Return what becomes of an image taken 1 m from the wall, with node 1 at x and node 2 out of sight."""
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    keyframes.add([observation_at(np.array([x, 1.0, 0.0]), 1), observation_at(np.array([4.8, 3.8, 3.0]), 2)])
    matcher = Matcher(predictor, keyframes, method.matching)
    deltas = novel_node(graph, HERE_IT_IS, predictor.encode([HERE_IT_IS]), matcher, method)
    for delta in deltas:
        graph.apply(delta)
    return deltas


def test_a_novel_node_is_tied_in_from_farther_away_than_in_building() -> None:
    graph = one_edge()
    deltas = novel(graph, 1.0 + 1.2 * ROBUST.building.connect_distance)
    assert 50 in graph.nodes
    assert (50, 1) in graph.edges
    assert (1, 50) in graph.edges
    assert {delta.cause for delta in deltas if isinstance(delta, NodeAdded)} == {Cause.NOVEL}


def test_what_is_almost_a_node_already_is_not_novel() -> None:
    assert novel(one_edge(), 1.05) == ()
    closer = replace(ROBUST, building=replace(ROBUST.building, merge_distance=0.0))
    assert novel(one_edge(), 1.05, closer) != ()


def test_what_touches_nothing_does_not_become_a_node() -> None:
    assert novel(one_edge(), 3.5) == ()


def test_a_frame_becomes_a_node_only_once() -> None:
    graph = one_edge()
    assert novel(graph, 2.1)
    assert novel(graph, 2.1) == ()


def test_what_hindered_the_robot_says_little_about_the_edge() -> None:
    graph, config = one_edge(p=0.9), ROBUST.believing
    hindered = AttemptEvidence(1, 2, 1.0, succeeded=False, hindered=True)
    for _ in range(10):
        for delta in update_edge(graph, hindered, config):
            graph.apply(delta)
    assert HINDERED_PRUNE_BELOW < graph.edges[1, 2].belief.p < config.prune_below
    assert any(
        isinstance(delta, EdgePruned)
        for delta in update_edge(graph, AttemptEvidence(1, 2, 1.0, succeeded=False), config)
    )
    for _ in range(20):
        for delta in update_edge(graph, hindered, config):
            graph.apply(delta)
    assert not graph.edges
