"""What would have been otherwise: nothing that is imagined is ever done."""

import itertools
from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz import palette
from ltvn_viz.modes import Mode
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import Theatre
from tests.viz.why_links import follow


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    """A live map of one room after a drive through it, the tool on show."""
    theatre = Theatre(tmp_path)
    theatre.do(c.ChooseTool(ToolName.WHAT_IF), c.NavigateTo(max(theatre.stage.mapping.graph.nodes)))
    theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    return theatre


def across(theatre: Theatre) -> tuple[int, int]:
    nodes = sorted(theatre.stage.mapping.graph.nodes)
    return nodes[0], nodes[-1]


def test_without_an_edge_of_the_plan_the_other_way_is_drawn_and_priced(theatre: Theatre) -> None:
    start, goal = across(theatre)
    theatre.do(c.Tell(f"from {start}"), c.Tell(f"goal {goal}"), c.Tell("belief weight = 0"), ticks=3)
    before = theatre.stage.mapping.graph.copy()
    path = plan_on_show(theatre.now)
    source, target = path[1]

    shown = theatre.do(c.Tell(f"without {source}->{target}"), ticks=3)

    assert "instead of" in shown.inspection.html
    assert f"{source} → {target}" in shown.inspection.html
    assert palette.PLAN in {stroke.colour for stroke in shown.inspection.view.overlay.strokes}
    assert theatre.stage.mapping.graph == before


def plan_on_show(snapshot: Snapshot) -> list[tuple[int, int]]:
    """Return the edges whose ends the strokes join."""
    graph = snapshot.moment.graph
    places = {tuple(pose[:2]): int(node) for node, pose in zip(graph.ids, graph.poses, strict=True)}
    strokes = [each for each in snapshot.inspection.view.overlay.strokes if each.colour == palette.PLAN]
    return [(places[each.start], places[each.end]) for each in strokes]


def test_the_edge_of_two_clicked_nodes_can_be_imagined_by_links(theatre: Theatre) -> None:
    source, target = next(iter(theatre.stage.mapping.graph.edges))
    shown = theatre.do(c.Pick(source), c.Pick(target))

    shown = follow(theatre, shown, f"p({source}-&gt;{target}) = 0.1")
    forgotten = follow(theatre, shown, "forget")

    assert f"<b>p({source}-&gt;{target}) = 0.1</b>" in shown.inspection.html
    assert "<b>p(" not in forgotten.inspection.html


def test_an_edge_that_is_not_in_the_map_can_be_imagined_in(theatre: Theatre) -> None:
    graph = theatre.stage.mapping.graph
    pairs = itertools.combinations(sorted(graph.nodes), 2)
    source, target = next(pair for pair in pairs if pair not in graph.edges)
    shown = theatre.do(c.Pick(source), c.Pick(target))

    shown = follow(theatre, shown, f"with {source}-&gt;{target}")

    assert f"<b>with {source}-&gt;{target}</b>" in shown.inspection.html
    assert (source, target) not in theatre.stage.mapping.graph.edges


def test_a_building_threshold_is_answered_by_building_on_the_side(theatre: Theatre) -> None:
    before = theatre.stage.mapping.graph.copy()

    shown = theatre.do(c.Tell("D_m = 0.8"), ticks=3)

    assert "fewer" in shown.inspection.html
    assert theatre.stage.mapping.graph.edges == before.edges


def test_a_pruning_threshold_is_counted(theatre: Theatre) -> None:
    shown = theatre.do(c.Tell("R_p = 0.3"), ticks=3)

    assert "edge would go" in shown.inspection.html


def test_what_nobody_can_imagine_is_answered_with_what_one_can(theatre: Theatre) -> None:
    shown = theatre.do(c.Tell("R_q = 0.3"))

    assert shown.message is not None
    assert "R_p = 1.3" in shown.message.text


def test_a_node_that_is_not_there_is_an_answer_and_can_be_forgotten(theatre: Theatre) -> None:
    shown = theatre.do(c.Tell("goal 987654"), ticks=3)

    assert "987654 is not in the map" in shown.inspection.html
    assert "987654" not in follow(theatre, shown, "forget").inspection.html


@pytest.mark.parametrize(
    ("system", "said"),
    [
        ("", "The recording names no system; both plans weigh edges as ltvn does."),
        ("ltvn", ""),
        ("sptm", "Both plans weigh edges as sptm does."),
        ("<b>", "The recording names the system “&lt;b&gt;”, which is not known here;"),
    ],
)
def test_a_replay_is_planned_by_the_system_that_its_recording_names(tmp_path: Path, system: str, said: str) -> None:
    theatre = Theatre(tmp_path)
    theatre.do(c.StartRecording(), c.KeepRecording())
    replay = theatre.open_replay(theatre.tapes[-1].path.name)
    replay.system = system
    theatre.stage.open_replay = lambda _: replay
    start, goal = across(theatre)
    theatre.do(c.OpenRecording(replay.name, 1e9), c.ChooseTool(ToolName.WHAT_IF), ticks=3)

    shown = theatre.do(c.Tell(f"from {start}"), c.Tell(f"goal {goal}"), ticks=3)

    assert said in shown.inspection.html
    assert ("weigh edges as" in shown.inspection.html) == bool(said)
    assert " nodes at cost " in shown.inspection.html
