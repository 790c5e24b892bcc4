"""Imagined changes can be typed, and are written as one types them."""

import pytest

from ltvn_core.analysis.change_text import EXAMPLES, change_text, parse_change
from ltvn_core.analysis.changes import BeliefSet, EdgeBarred, EdgeForced, GoalSet, Threshold, ThresholdSet
from ltvn_core.config import ROBUST
from ltvn_core.errors import LtvnError, MapError, OptionError
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow
from ltvn_core.graph.topograph import TopologicalGraph


@pytest.fixture
def graph() -> TopologicalGraph:
    """Two places a metre apart, joined one way."""
    here, there = Node(12, PoseRow(0, 0, 0)), Node(40, PoseRow(1, 0, 0))
    edge = Edge(12, 40, PoseRow(1, 0, 0), Belief(0.6, 1.1, 0.02))
    return TopologicalGraph([*(NodeAdded(node, Cause.BUILD) for node in (here, there)), EdgeAdded(edge, Cause.BUILD)])


@pytest.mark.parametrize("text", EXAMPLES)
def test_each_example_is_read_and_written_back(text: str, graph: TopologicalGraph) -> None:
    change = parse_change(text, graph)

    assert parse_change(change_text(change), graph) == change


def test_what_is_typed_means_what_it_says(graph: TopologicalGraph) -> None:
    assert parse_change("without 12 → 40", graph) == EdgeBarred(12, 40)
    assert parse_change(" P( 12->40 )=.1", graph) == BeliefSet(12, 40, p=0.1)
    assert parse_change("mu(12->40) = 2", graph) == BeliefSet(12, 40, mu=2.0)
    assert parse_change("GOAL 40", graph) == GoalSet(40)
    assert parse_change("d_c=1.3", graph) == ThresholdSet(Threshold.D_C, 1.3)


def test_an_edge_that_is_there_keeps_its_belief_and_a_new_one_is_believed_in(graph: TopologicalGraph) -> None:
    known, fresh = parse_change("with 12->40", graph), parse_change("with 40->12", graph)

    assert isinstance(known, EdgeForced)
    assert known.belief == Belief(0.6, 1.1, 0.02)
    assert isinstance(fresh, EdgeForced)
    assert fresh.belief.p == ROBUST.believing.p_cap


def test_a_new_edge_needs_both_of_its_nodes(graph: TopologicalGraph) -> None:
    with pytest.raises(MapError, match="99"):
        parse_change("with 12->99", graph)


@pytest.mark.parametrize(
    "text", ["", "goal", "goal kitchen", "R_q = 1", "R_p = high", "R_p = nan", "p(1) = 2", "12->40"]
)
def test_anything_else_is_answered_with_what_can_be_typed(text: str, graph: TopologicalGraph) -> None:
    with pytest.raises(OptionError) as told:
        parse_change(text, graph)

    assert "write" in str(told.value)
    assert isinstance(told.value, LtvnError)
