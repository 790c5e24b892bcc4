"""Changes by hand: done live, recorded, seen in the replay, and undone."""

import itertools
from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import Theatre
from tests.viz.why_links import follow, links


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    """A live map of one room with the tool on show."""
    theatre = Theatre(tmp_path)
    theatre.do(c.ChooseTool(ToolName.HAND))
    return theatre


def an_edge(theatre: Theatre) -> tuple[int, int]:
    return next(iter(theatre.stage.mapping.graph.edges))


def test_an_edge_is_cut_and_comes_back_as_it_was(theatre: Theatre) -> None:
    before, edge = theatre.stage.mapping.graph.copy(), an_edge(theatre)
    theatre.do(c.Pick(edge[0]))

    cut = follow(theatre, theatre.do(c.Pick(edge[1])), "cut")
    graph = theatre.stage.mapping.graph.copy()
    follow(theatre, cut, "undo")

    assert edge not in graph.edges
    assert f"edge {edge[0]} → {edge[1]} cut" in cut.inspection.html
    assert theatre.stage.mapping.graph == before


def test_a_deleted_node_comes_back_with_its_edges(theatre: Theatre) -> None:
    before, node = theatre.stage.mapping.graph.copy(), an_edge(theatre)[0]

    gone = follow(theatre, theatre.do(c.Pick(node)), "delete")
    graph = theatre.stage.mapping.graph.copy()
    follow(theatre, gone, "undo")

    assert node not in graph.nodes
    assert theatre.stage.mapping.graph == before


def test_two_clicked_nodes_are_joined(theatre: Theatre) -> None:
    graph = theatre.stage.mapping.graph
    source, target = next(pair for pair in itertools.combinations(sorted(graph.nodes), 2) if pair not in graph.edges)
    theatre.do(c.Pick(source))

    follow(theatre, theatre.do(c.Pick(target)), "add")

    assert (source, target) in theatre.stage.mapping.graph.edges


def test_a_protected_edge_can_be_let_go_again(theatre: Theatre) -> None:
    edge = an_edge(theatre)

    shown = follow(theatre, theatre.do(c.PointAt(*edge)), "protect")
    protected = theatre.stage.mapping.graph.edges[edge].protected
    follow(theatre, shown, "allow pruning")

    assert protected
    assert not theatre.stage.mapping.graph.edges[edge].protected


def test_a_named_goal_has_a_label_and_is_in_the_recording(theatre: Theatre) -> None:
    node = an_edge(theatre)[0]
    theatre.do(c.StartRecording(), c.Pick(node), ticks=2)
    shown = theatre.do(c.Tell("name the <big> kitchen"), ticks=3)

    shown = follow(theatre, shown, "as a goal")
    theatre.do(c.KeepRecording())
    replayed = theatre.do(c.OpenRecording(theatre.tapes[-1].path.name, at_s=1e9), ticks=3)

    assert theatre.stage.mapping.graph.nodes[node].name == "the <big> kitchen"
    assert [label.text for label in shown.inspection.view.overlay.labels] == ["★ the <big> kitchen"]
    assert [label.text for label in replayed.inspection.view.overlay.labels] == ["★ the <big> kitchen"]
    assert "the &lt;big&gt; kitchen" in replayed.inspection.html
    assert "A recording cannot be changed" in replayed.inspection.html
    assert not [label for _, label in links(replayed) if label == "undo"]


def test_a_name_is_asked_for_only_when_a_node_is_chosen(theatre: Theatre) -> None:
    shown = theatre.do(c.Tell("name kitchen"))

    assert shown.inspection.view.asks == ""
    assert shown.message is not None
    assert "Click the node first" in shown.message.text


def test_a_name_that_is_taken_is_refused_with_its_holder(theatre: Theatre) -> None:
    first, second = an_edge(theatre)
    theatre.do(c.Pick(first))
    theatre.do(c.Tell("name kitchen"), ticks=3)

    theatre.do(c.Pick(second))
    shown = theatre.do(c.Tell("name kitchen"))

    assert shown.message is not None
    assert f"Node {first} is called 'kitchen' already" in shown.message.text


def test_the_map_is_not_changed_while_the_robot_drives_by_itself(theatre: Theatre) -> None:
    edge = an_edge(theatre)
    shown = theatre.do(c.PointAt(*edge), c.NavigateTo(max(theatre.stage.mapping.graph.nodes)))

    shown = follow(theatre, shown, "cut", ticks=1)

    assert edge in theatre.stage.mapping.graph.edges
    assert shown.message is not None
    assert "works while driving" in shown.message.text
