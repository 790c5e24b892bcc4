"""A person changes edges of the map, and every such change can be taken back."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from ltvn_core.analysis import manual_edits
from ltvn_core.config import ROBUST
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import LtvnError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.operators import AttemptEvidence, update_edge
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from tests.repository import ROOT

BELIEVING = ROBUST.believing


def corridor() -> TopologicalGraph:
    """Three places a metre apart, joined ahead."""
    graph = TopologicalGraph(d.NodeAdded(d.Node(k, d.PoseRow(float(k), 0.0, 0.0)), d.Cause.BUILD) for k in range(3))
    for k in range(2):
        belief = d.Belief(BELIEVING.p_cap, 1.0, BELIEVING.sigma2)
        graph.apply(d.EdgeAdded(d.Edge(k, k + 1, d.PoseRow(1.0, 0.0, 0.0), belief), d.Cause.BUILD))
    return graph


def undone(deltas: Iterable[d.GraphDelta], before: TopologicalGraph) -> list[d.GraphDelta]:
    """The deltas that lead from the map after `deltas` back to the one before."""
    graph = before.copy()
    back: list[d.GraphDelta] = []
    for delta in deltas:
        back = [*manual_edits.inverse_deltas(delta, graph), *back]
        graph.apply(delta)
    return back


def test_a_removed_edge_comes_back_as_it_was_and_can_be_removed_again() -> None:
    graph = corridor()
    graph.apply(manual_edits.protect_edge(graph, 0, 1))
    graph.apply(d.PresenceObserved(0, 1, present=False, stamp=3.0, cause=d.Cause.ATTEMPT))
    before, cut = graph.copy(), manual_edits.remove_edge(graph, 0, 1)
    back = undone([cut], before)
    graph.apply(cut)
    again = undone(back, graph)
    removed = graph.copy()
    for delta in back:
        graph.apply(delta)
    assert graph == before
    for delta in again:
        graph.apply(delta)
    assert graph == removed


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
    actions = {key: edge.action for key, edge in graph.edges.items() if edge.action}
    assert actions == {(0, 1): "Open the door", (2, 0): "Take the lift to floor 2"}
    assert graph.edges[2, 0].belief.mu == 30.0
    assert all(graph.edges[key].protected for key in actions)
    assert graph.edges[0, 1].belief == before.edges[0, 1].belief
    assert Recording.open(tmp_path / "map.rrd").final_graph() == graph
    for delta in back:
        graph.apply(delta)
    assert graph == before


def test_a_map_from_before_names_existed_still_opens() -> None:
    graph = Recording.open(ROOT / "tests" / "data" / "golden-schema-1.rrd").final_graph()
    assert graph.nodes
    assert not graph.names
    assert not any(edge.action for edge in graph.edges.values())


def test_edits_of_nodes_in_an_earlier_recording_still_open_but_are_not_taken_back(tmp_path: Path) -> None:
    graph = corridor()
    made = [d.NodeNamed(1, "kitchen", goal=True, cause=d.Cause.HAND), d.NodeDropped(2, d.Cause.HAND)]
    with RecordingWriter(tmp_path / "map.rrd", scene="demo", config={}, fingerprint="") as writer:
        for delta in (*graph.deltas(), *made):
            writer.write_event(StampedEvent(0, 0.0, GraphChanged(delta)))
    read = Recording.open(tmp_path / "map.rrd").final_graph()
    assert (read.nodes[1].name, read.nodes[1].goal) == ("kitchen", True)
    assert 2 not in read.nodes
    assert [manual_edits.inverse_deltas(delta, graph) for delta in made] == [(), ()]


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda graph: manual_edits.remove_edge(graph, 1, 0), "Edge 1 -> 0 is not in the map"),
        (lambda graph: manual_edits.protect_edge(graph, 1, 0), "Edge 1 -> 0 is not in the map"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 7, "Jump"), "Node 7 is not in the map"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 0, "Jump"), "no edge to itself"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 2, " "), "cannot be an action"),
        (lambda graph: manual_edits.connect_by_action(graph, 0, 2, "Jump", mu=-1.0), "cannot cost"),
    ],
)
def test_what_cannot_be_done_is_said(attempt, message: str) -> None:  # noqa: ANN001
    graph = corridor()
    before = graph.copy()
    with pytest.raises(LtvnError, match=message):
        attempt(graph)
    assert graph == before
