"""A person changes the map, and every change can be taken back."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.analysis import manual_edits
from ltvn_core.config import ROBUST
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import LtvnError
from ltvn_core.geometry import distance
from ltvn_core.graph.deltas import Belief, Cause, GraphDelta, Node, NodeAdded, PoseRow
from ltvn_core.graph.maintenance import AttemptEvidence, update_edge
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from tests.core.graph.test_topograph import histories
from tests.repository import ROOT

BELIEVING = ROBUST.believing


def corridor() -> TopologicalGraph:
    """Three places a metre apart, joined ahead by hand."""
    graph = TopologicalGraph(NodeAdded(Node(k, PoseRow(float(k), 0.0, 0.0)), Cause.BUILD) for k in range(3))
    for k in range(2):
        graph.apply(manual_edits.add_edge(graph, k, k + 1, BELIEVING))
    return graph


def undone(deltas: Iterable[GraphDelta], before: TopologicalGraph) -> list[GraphDelta]:
    """The deltas that lead from the map after `deltas` back to the one before."""
    graph = before.copy()
    back: list[GraphDelta] = []
    for delta in deltas:
        back = [*manual_edits.inverse_deltas(delta, graph), *back]
        graph.apply(delta)
    return back


@given(histories(), st.integers(0, 60))
def test_whatever_happened_can_be_taken_back(history: list[GraphDelta], kept: int) -> None:
    before = TopologicalGraph(history[:kept])
    after = TopologicalGraph(history)
    for delta in undone(history[kept:], before):
        assert delta.cause is Cause.HAND
        after.apply(delta)
    assert after == before
    assert dict(after.names) == dict(before.names)


@given(histories())
def test_undoing_the_undoing_does_it_again(history: list[GraphDelta]) -> None:
    before, after = TopologicalGraph(), TopologicalGraph(history)
    back = undone(history, before)
    again = undone(back, after)
    assert TopologicalGraph(again) == after


def test_a_new_edge_goes_where_odometry_says_unless_told_otherwise() -> None:
    graph = corridor()
    back = manual_edits.add_edge(graph, 2, 1, BELIEVING)
    assert back.cause is Cause.HAND
    assert tuple(back.edge.waypoint) == pytest.approx((-1.0, 0.0, 0.0))
    assert back.edge.belief == Belief(BELIEVING.p_cap, 1.0, BELIEVING.sigma2)
    seen = np.array([0.5, 0.1, 0.3])
    assert manual_edits.add_edge(graph, 2, 0, BELIEVING, waypoint=seen).edge.belief.mu == pytest.approx(distance(seen))


def test_a_protected_edge_outlives_its_failures() -> None:
    graph = corridor()
    graph.apply(manual_edits.protect_edge(graph, 0, 1))
    for _ in range(9):
        for delta in update_edge(graph, AttemptEvidence(0, 1, 1.0, succeeded=False), BELIEVING):
            graph.apply(delta)
    assert graph.edges[0, 1].belief.p < BELIEVING.prune_below
    graph.apply(manual_edits.protect_edge(graph, 0, 1, protected=False))
    for delta in update_edge(graph, AttemptEvidence(0, 1, 1.0, succeeded=False), BELIEVING):
        graph.apply(delta)
    assert (0, 1) not in graph.edges


def test_a_goal_has_a_name_that_survives_saving(tmp_path: Path) -> None:
    graph = corridor()
    for delta in (manual_edits.mark_goal(graph, 1, "  kitchen\n door "), manual_edits.protect_edge(graph, 0, 1)):
        graph.apply(delta)
    assert graph.nodes[1].goal
    assert graph.names == {"kitchen door": 1}
    graph.apply(manual_edits.mark_goal(graph, 1, goal=False))
    with RecordingWriter(tmp_path / "map.rrd", scene="demo", config={}, fingerprint="") as writer:
        for delta in graph.deltas():
            writer.write_event(StampedEvent(0, 0.0, GraphChanged(delta)))
    read = Recording.open(tmp_path / "map.rrd").final_graph()
    assert read == graph
    assert (read.nodes[1].name, read.nodes[1].goal) == ("kitchen door", False)


def test_two_nodes_are_joined_by_an_action_that_survives_saving_and_can_be_taken_back(tmp_path: Path) -> None:
    graph = corridor()
    before = graph.copy()
    made = [
        *manual_edits.connect_by_action(graph, 0, 1, "Open the door"),
        *manual_edits.connect_by_action(graph, 2, 0, " Take the lift\n to floor 2", mu=30.0),
    ]
    back = undone(made, before)
    with RecordingWriter(tmp_path / "map.rrd", scene="demo", config={}, fingerprint="") as writer:
        for delta in (*graph.deltas(), *made):
            graph.apply(delta) if delta in made else None
            writer.write_event(StampedEvent(0, 0.0, GraphChanged(delta)))
    assert graph.actions == {(0, 1): "Open the door", (2, 0): "Take the lift to floor 2"}
    assert graph.edges[2, 0].belief.mu == 30.0
    assert all(graph.edges[key].protected for key in graph.actions)
    assert graph.edges[0, 1].belief == before.edges[0, 1].belief
    assert Recording.open(tmp_path / "map.rrd").final_graph() == graph
    for delta in back:
        graph.apply(delta)
    assert graph == before


def test_a_map_from_before_names_existed_still_opens() -> None:
    graph = Recording.open(ROOT / "tests" / "data" / "golden-schema-1.rrd").final_graph()
    assert graph.nodes
    assert not graph.names
    assert not graph.actions


def test_a_deleted_node_comes_back_with_its_edges_and_its_name() -> None:
    graph = corridor()
    graph.apply(manual_edits.rename_node(graph, 1, "door"))
    before = graph.copy()
    delta = manual_edits.delete_node(graph, 1)
    back = manual_edits.inverse_deltas(delta, graph)
    graph.apply(delta)
    assert not graph.edges
    for step in back:
        graph.apply(step)
    assert graph == before


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda graph: manual_edits.add_edge(graph, 0, 1, BELIEVING), "in the map already"),
        (lambda graph: manual_edits.add_edge(graph, 0, 0, BELIEVING), "no edge to itself"),
        (lambda graph: manual_edits.add_edge(graph, 0, 7, BELIEVING), "Node 7 is not in the map"),
        (lambda graph: manual_edits.add_edge(graph, 2, 0, BELIEVING, waypoint=np.full(3, np.nan)), "nan long"),
        (lambda graph: manual_edits.add_edge(graph, 2, 0, BELIEVING, waypoint=np.array([9.0, 0, 0])), "9.0 long"),
        (lambda graph: manual_edits.remove_edge(graph, 1, 0), "Edge 1 -> 0 is not in the map"),
        (lambda graph: manual_edits.protect_edge(graph, 1, 0), "Edge 1 -> 0 is not in the map"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 7, "Jump"), "Node 7 is not in the map"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 0, "Jump"), "no edge to itself"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 2, " "), "cannot be an action"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 2, "Jump", mu=-1.0), "cannot cost"),
        (lambda graph: manual_edits.delete_node(graph, 7), "Node 7 is not in the map"),
        (lambda graph: manual_edits.rename_node(graph, 0, "x" * 61), "cannot be a name"),
        (lambda graph: manual_edits.rename_node(graph, 0, "bell \x07"), "cannot be a name"),
        (lambda graph: manual_edits.mark_goal(graph, 0, "taken"), "Node 2 is called 'taken' already"),
    ],
)
def test_what_cannot_be_done_is_said(attempt, message: str) -> None:  # noqa: ANN001
    graph = corridor()
    graph.apply(manual_edits.rename_node(graph, 2, "taken"))
    before = graph.copy()
    with pytest.raises(LtvnError, match=message):
        attempt(graph)
    assert graph == before
