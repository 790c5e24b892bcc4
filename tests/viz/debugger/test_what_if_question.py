"""What would have been otherwise: nothing that is imagined is ever done."""

import itertools
from pathlib import Path

import pytest

from ltvn_core import palette
from ltvn_core.analysis.answer import Paragraph, Strong
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.viz.debugger.answer_links import answer_of, follow, words
from tests.viz.session_harness import SessionHarness


@pytest.fixture
def harness(harness: SessionHarness) -> SessionHarness:
    """A live map of one room with the tool on show."""
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.WHAT_IF))
    return harness


def strong(snapshot: Snapshot) -> list[Strong]:
    """Return what stands out in the answer, such as what is imagined."""
    lines = [block for block in answer_of(snapshot).blocks if isinstance(block, Paragraph)]
    return [part for line in lines for part in line.parts if isinstance(part, Strong)]


def across(harness: SessionHarness) -> tuple[int, int]:
    nodes = sorted(harness.state.live_map.graph.nodes)
    return nodes[0], nodes[-1]


def test_without_an_edge_of_the_plan_the_other_way_is_drawn_and_priced(harness: SessionHarness) -> None:
    start, goal = across(harness)
    harness.do(
        c.Ask(c.Action.TELL, f"from {start}"),
        c.Ask(c.Action.TELL, f"goal {goal}"),
        c.Ask(c.Action.TELL, "belief weight = 0"),
        ticks=3,
    )
    before = harness.state.live_map.graph.copy()
    path = plan_on_show(harness.now)
    source, target = path[1]
    shown = harness.do(c.Ask(c.Action.TELL, f"without {source}->{target}"), ticks=3)
    assert "instead of" in words(shown)
    assert f"{source} → {target}" in words(shown)
    assert palette.PLAN in {stroke.colour for stroke in shown.inspection.answer.overlay.strokes}
    assert harness.state.live_map.graph == before


def plan_on_show(snapshot: Snapshot) -> list[tuple[int, int]]:
    """Return the edges whose ends the strokes join."""
    graph = snapshot.moment.graph
    places = {tuple(pose[:2]): int(node) for node, pose in zip(graph.ids, graph.poses, strict=True)}
    strokes = [each for each in snapshot.inspection.answer.overlay.strokes if each.colour == palette.PLAN]
    return [(places[each.start], places[each.end]) for each in strokes]


def test_the_edge_of_two_clicked_nodes_can_be_imagined_by_links(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    shown = harness.do(c.Ask(c.Action.PICK, source), c.Ask(c.Action.PICK, target))
    shown = follow(harness, shown, f"p({source}->{target}) = 0.1")
    forgotten = follow(harness, shown, "forget")
    assert Strong(f"p({source}->{target}) = 0.1") in strong(shown)
    assert strong(forgotten) == []


def test_an_edge_that_is_not_in_the_map_can_be_imagined_in(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    pairs = itertools.combinations(sorted(graph.nodes), 2)
    source, target = next(pair for pair in pairs if pair not in graph.edges)
    shown = harness.do(c.Ask(c.Action.PICK, source), c.Ask(c.Action.PICK, target))
    shown = follow(harness, shown, f"with {source}->{target}")
    assert Strong(f"with {source}->{target}") in strong(shown)
    assert (source, target) not in harness.state.live_map.graph.edges


def test_a_node_that_is_not_there_is_an_answer_and_can_be_forgotten(harness: SessionHarness) -> None:
    shown = harness.do(c.Ask(c.Action.TELL, "goal 987654"), ticks=3)
    assert "987654 is not in the map" in words(shown)
    assert "987654" not in words(follow(harness, shown, "forget"))


@pytest.mark.parametrize(
    ("system", "said"),
    [
        ("", "The recording names no system; both plans use the edge costs of ltvn."),
        ("ltvn", ""),
        ("sptm", "Both plans use the edge costs of sptm."),
        ("<b>", "The recording names the system “<b>”, which is not known here;"),
    ],
)
def test_a_replay_is_planned_by_the_system_that_its_recording_names(tmp_path: Path, system: str, said: str) -> None:
    harness = SessionHarness(tmp_path)
    harness.do(c.Ask(c.Action.RECORD), c.Ask(c.Action.KEEP))
    replay = harness.open_replay(harness.writers[-1].path.name)
    replay.system = system
    harness.state.open_replay = lambda _: replay
    start, goal = across(harness)
    harness.do(c.OpenRecording(replay.name, 1e9), c.Ask(c.Action.QUESTION, QuestionName.WHAT_IF), ticks=3)
    shown = harness.do(c.Ask(c.Action.TELL, f"from {start}"), c.Ask(c.Action.TELL, f"goal {goal}"), ticks=3)
    assert said in words(shown)
    assert ("use the edge costs of" in words(shown)) == bool(said)
    assert " nodes at cost " in words(shown)
