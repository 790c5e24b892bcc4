"""Changes by hand: done live, recorded, seen in the replay, and undone."""

import itertools

import pytest

from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes import commands as c
from tests.viz.debugger.answer_links import follow, links, words
from tests.viz.session_harness import SessionHarness, said


@pytest.fixture
def harness(harness: SessionHarness) -> SessionHarness:
    """A live map of one room with the tool on show."""
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.HAND))
    return harness


def test_an_edge_is_cut_and_comes_back_as_it_was(harness: SessionHarness) -> None:
    before, edge = harness.state.live_map.graph.copy(), harness.an_edge
    harness.do(c.Ask(c.Action.PICK, edge[0]))
    cut = follow(harness, harness.do(c.Ask(c.Action.PICK, edge[1])), "cut")
    graph = harness.state.live_map.graph.copy()
    follow(harness, cut, "undo")
    assert edge not in graph.edges
    assert f"edge {edge[0]} → {edge[1]} pruned (hand)" in words(cut)
    assert harness.state.live_map.graph == before


def test_two_nodes_are_connected_by_an_action_in_both_directions_and_the_edge_tells_it(harness: SessionHarness) -> None:
    before = harness.state.live_map.graph.copy()
    pair = next(pair for pair in itertools.combinations(sorted(before.nodes), 2) if pair not in before.edges)
    harness.do(c.Ask(c.Action.PICK, pair[0]))
    asked = follow(harness, harness.do(c.Ask(c.Action.PICK, pair[1])), "by an action")
    follow(harness, asked, "both ways")
    harness.do(c.Ask(c.Action.TELL, "Open the red door"), ticks=3)
    assert asked.inspection.answer.input_hint
    edges = harness.state.live_map.graph.edges
    assert {key: edge.action for key, edge in edges.items() if edge.action} == dict.fromkeys(
        [pair, pair[::-1]], "Open the red door"
    )
    told = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.PointAt(*pair), ticks=3)
    assert ("Open the red door" in words(told), "Predicted" in words(told)) == (True, False)
    assert not told.inspection.answer.overlay.ghosts
    done = harness.do(c.Ask(c.Action.QUESTION, QuestionName.HAND), ticks=3)
    follow(harness, done, "undo")
    assert harness.state.live_map.graph == before


def test_nodes_are_neither_added_nor_changed_by_hand(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    source, target = next(pair for pair in itertools.combinations(sorted(graph.nodes), 2) if pair not in graph.edges)
    harness.do(c.Ask(c.Action.PICK, source))
    offered = [label for _, label in links(harness.do(c.Ask(c.Action.PICK, target)))]
    assert offered == [f"connect {source} → {target} by an action"]


def test_a_protected_edge_can_be_let_go_again(harness: SessionHarness) -> None:
    edge = harness.an_edge
    shown = follow(harness, harness.do(c.PointAt(*edge)), "protect")
    protected = harness.state.live_map.graph.edges[edge].protected
    follow(harness, shown, "allow pruning")
    assert protected
    assert not harness.state.live_map.graph.edges[edge].protected


def test_a_change_is_in_the_recording_which_itself_cannot_be_changed(harness: SessionHarness) -> None:
    edge = harness.an_edge
    harness.do(c.Ask(c.Action.RECORD), ticks=2)
    follow(harness, harness.do(c.PointAt(*edge)), "cut")
    harness.do(c.Ask(c.Action.KEEP))
    replayed = harness.do(c.OpenRecording(harness.writers[-1].path.name, at_s=1e9), ticks=3)
    assert f"edge {edge[0]} → {edge[1]} pruned (hand)" in words(replayed)
    assert "A recording cannot be changed" in words(replayed)
    assert not [label for _, label in links(replayed) if label == "undo"]


def test_the_map_is_not_changed_while_the_robot_drives_by_itself(harness: SessionHarness) -> None:
    edge = harness.an_edge
    shown = harness.do(c.PointAt(*edge), c.Ask(c.Action.GOAL, max(harness.state.live_map.graph.nodes)))
    shown = follow(harness, shown, "cut", ticks=1)
    assert edge in harness.state.live_map.graph.edges
    assert "not possible" in said(shown)
