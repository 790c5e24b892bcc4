"""Imagined changes can be typed, and are written as one types them."""

import pytest

from ltvn_core.analysis import what_if_changes as w
from ltvn_core.analysis.what_if_scenario import PlannerState, WhatIfScenario, apply_what_if_changes
from ltvn_core.config import ROBUST
from ltvn_core.errors import LtvnError, MapError, OptionError
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow
from ltvn_core.graph.topological_graph import TopologicalGraph


@pytest.fixture
def graph() -> TopologicalGraph:
    """Two places a metre apart, joined one way."""
    here, there = Node(12, PoseRow(0, 0, 0)), Node(40, PoseRow(1, 0, 0))
    edge = Edge(12, 40, PoseRow(1, 0, 0), Belief(0.6, 1.1, 0.02))
    return TopologicalGraph([*(NodeAdded(node, Cause.BUILD) for node in (here, there)), EdgeAdded(edge, Cause.BUILD)])


@pytest.mark.parametrize("text", w.WHAT_IF_EXAMPLES)
def test_each_example_is_read_and_written_back(text: str) -> None:
    change = w.parse_what_if_change(text)
    assert w.parse_what_if_change(w.format_what_if_change(change)) == change


def test_what_is_typed_means_what_it_says() -> None:
    assert w.parse_what_if_change("without 12 → 40") == w.WithoutEdge(12, 40)
    assert w.parse_what_if_change(" P( 12->40 )=.1") == w.WithBelief(12, 40, p=0.1)
    assert w.parse_what_if_change("mu(12->40) = 2") == w.WithBelief(12, 40, mu=2.0)
    assert w.parse_what_if_change("GOAL 40") == w.WithGoal(40)
    assert w.parse_what_if_change("d_c=1.3") == w.WithThreshold(w.WhatIfThreshold.D_C, 1.3)


def imagined(graph: TopologicalGraph, text: str) -> TopologicalGraph:
    scenario = WhatIfScenario(graph, PlannerState(None, None), ROBUST)
    return apply_what_if_changes(scenario, [w.parse_what_if_change(text)]).graph


def test_an_edge_that_is_there_keeps_its_belief_and_a_new_one_is_believed_in(graph: TopologicalGraph) -> None:
    known, fresh = imagined(graph, "with 12->40"), imagined(graph, "with 40->12")
    assert known.edges[12, 40].belief == Belief(0.6, 1.1, 0.02)
    assert fresh.edges[40, 12].belief.p == ROBUST.believing.p_cap


def test_an_imagined_edge_has_the_belief_of_the_map_it_is_imagined_in(graph: TopologicalGraph) -> None:
    change, learned = w.parse_what_if_change("with 12->40"), Belief(0.3, 1.4, 0.02)
    graph.apply(BeliefUpdated(12, 40, learned, 1, 0, Cause.ATTEMPT))
    scenario = WhatIfScenario(graph, PlannerState(None, None), ROBUST)
    assert apply_what_if_changes(scenario, [change]).graph.edges[12, 40].belief == learned


def test_a_new_edge_needs_both_of_its_nodes(graph: TopologicalGraph) -> None:
    with pytest.raises(MapError, match="99"):
        imagined(graph, "with 12->99")


@pytest.mark.parametrize(
    "text", ["", "goal", "goal kitchen", "R_q = 1", "R_p = high", "R_p = nan", "p(1) = 2", "12->40"]
)
def test_anything_else_is_answered_with_what_can_be_typed(text: str) -> None:
    with pytest.raises(OptionError) as told:
        w.parse_what_if_change(text)
    assert "write" in str(told.value)
    assert isinstance(told.value, LtvnError)
