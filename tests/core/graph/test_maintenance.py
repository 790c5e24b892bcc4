"""Driving strengthens edges, weakens them, prunes them in time, and adds what nobody knew."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ltvn_core.config import PAPER, ROBUST, BeliefConfig, Method
from ltvn_core.graph.deltas import Belief, Cause, EdgePruned, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import (
    HINDERED_PRUNE_BELOW,
    AttemptEvidence,
    initial_belief,
    novel_node,
    update_belief,
    update_edge,
    update_existence,
    update_length,
)
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.core.flat_world import FlatPredictor, observation_at, one_room
from tests.core.graph.small_maps import edge_added, node_added


def one_edge(p: float = 0.8, *, protected: bool = False) -> TopologicalGraph:
    return TopologicalGraph([node_added(1), node_added(2), edge_added(1, 2, p=p, protected=protected)])


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


chances = st.floats(0.01, 0.95)
configs = st.builds(
    lambda if_there, if_not: BeliefConfig(p_success_if_reachable=if_there, p_success_if_not=if_not),
    st.floats(0.5, 0.99),
    st.floats(0.01, 0.45),
)


@given(chances, configs)
def test_a_success_never_lowers_p_and_a_failure_never_raises_it(p: float, config: BeliefConfig) -> None:
    assert update_existence(p, config, succeeded=True) >= min(p, config.p_cap) - 1e-12
    assert update_existence(p, config, succeeded=False) <= p + 1e-12


@given(chances, chances, configs, st.booleans())
def test_a_more_believed_edge_stays_more_believed(p: float, q: float, config: BeliefConfig, succeeded: bool) -> None:
    assume(p <= q)
    assert update_existence(p, config, succeeded=succeeded) <= update_existence(q, config, succeeded=succeeded) + 1e-12


@given(chances, st.lists(st.booleans(), max_size=30), configs)
def test_p_stays_between_zero_and_the_cap(p: float, history: list[bool], config: BeliefConfig) -> None:
    for succeeded in history:
        p = update_existence(p, config, succeeded=succeeded)
        assert 0 <= p <= config.p_cap


@given(chances, configs, st.lists(st.booleans(), min_size=2, max_size=6))
def test_below_the_cap_the_order_of_the_evidence_does_not_matter(
    p: float, config: BeliefConfig, history: list[bool]
) -> None:
    free = replace(config, p_cap=1.0)

    def after(attempts: list[bool]) -> float:
        q = p
        for succeeded in attempts:
            q = update_existence(q, free, succeeded=succeeded)
        return q

    assert after(history) == pytest.approx(after(sorted(history)), abs=1e-9)


def test_bayes_by_hand() -> None:
    config = BeliefConfig(p_success_if_reachable=0.8, p_success_if_not=0.2, p_cap=1.0)
    assert update_existence(0.5, config, succeeded=True) == pytest.approx(0.8)
    assert update_existence(0.5, config, succeeded=False) == pytest.approx(0.2)


def test_an_impossible_observation_leaves_the_belief_alone() -> None:
    config = BeliefConfig(p_success_if_reachable=1.0, p_success_if_not=1.0)
    assert update_existence(0.7, config, succeeded=False) == 0.7


@given(st.floats(0, 3), st.lists(st.floats(0, 3), min_size=1, max_size=20))
def test_the_length_is_the_running_mean_of_all_measurements(first: float, others: list[float]) -> None:
    config = BeliefConfig()
    belief = initial_belief(0.9, first, config)
    for measured in others:
        belief = Belief(belief.p, *update_length(belief, measured, config))
    assert belief.mu == pytest.approx(np.mean([first, *others]), abs=1e-9)
    assert belief.sigma2 == pytest.approx(config.sigma2 / (len(others) + 1))


def test_a_failure_teaches_nothing_about_the_length() -> None:
    before = Belief(0.8, 1.0, 0.02)
    after = update_belief(before, 3.0, BeliefConfig(), succeeded=False)
    assert (after.mu, after.sigma2) == (before.mu, before.sigma2)
    assert after.p < before.p


def test_a_new_edge_is_believed_as_far_as_the_network_does_but_not_past_the_cap() -> None:
    assert initial_belief(0.7, 1.2, BeliefConfig()).p == 0.7
    assert initial_belief(0.999, 1.2, BeliefConfig()).p == BeliefConfig().p_cap
