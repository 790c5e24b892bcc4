"""Comparing, truth and sharing in the Why tab, on a live flat world and on the demo's recording."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core import palette
from ltvn_core.analysis.answer import Address, Copyable, Download, Inline, Paragraph
from ltvn_core.analysis.answer_text import answer_text
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.graph.deltas import Cause, EdgeAdded, EdgePruned
from ltvn_core.types import Observation
from ltvn_viz.debugger.comparison_question import BEFORE_FIRST_QUERY
from ltvn_viz.debugger.ground_truth_question import GroundTruthQuestion
from ltvn_viz.debugger.share_question import ShareAction
from ltvn_viz.session.activities.playback import open_replay
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionName
from ltvn_viz.session.share_links import commands_from_link
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.data.importing.plan_files import laid_room
from tests.repository import DEMO_MAP, RECORDINGS
from tests.viz.debugger import answer_links
from tests.viz.debugger.answer_links import words
from tests.viz.session_harness import SessionHarness, said


@pytest.fixture
def demo(tmp_path: Path) -> SessionHarness:
    """The demo's drive, open at its end, beside its map."""
    for name in ("demo-drive.rrd", "demo-map.rrd"):
        shutil.copy(RECORDINGS / name, tmp_path / name)
    harness = SessionHarness(tmp_path, mapped=False)
    harness.state.open_replay = lambda name: open_replay(harness.library, name)
    harness.do(c.OpenRecording("demo-drive.rrd", 1e9), ticks=2)
    return harness


def follow(harness: SessionHarness, label: str) -> Snapshot:
    """Click the link with these words."""
    return answer_links.follow(harness, harness.now, label)


def pieces(snapshot: Snapshot) -> list[Inline]:
    """Return the pieces of the lines of the answer."""
    blocks = snapshot.inspection.answer.answer.blocks
    return [part for block in blocks if isinstance(block, Paragraph) for part in block.parts]


def colours(snapshot: Snapshot) -> set[palette.Rgb8]:
    return {each.colour for each in snapshot.inspection.answer.overlay.strokes}


def test_a_drive_is_compared_with_the_map_of_another_drive(demo: SessionHarness) -> None:
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE))
    shown = follow(demo, "demo-map.rrd")
    assert "nodes are in both, matched by their pose" in words(shown)
    assert (
        {palette.EDGE_ADDED, palette.EDGE_REMOVED}
        <= colours(shown)
        <= {palette.EDGE_ADDED, palette.EDGE_REMOVED, palette.PLAN}
    )
    first = shown.inspection.answer.links[1]
    assert isinstance(first, c.PointAt)
    pointed = demo.do(c.PointAt(first.node, first.target), ticks=2)
    assert f"{first.node} → {first.target}" in words(pointed)
    assert {first.node, first.target} == set(pointed.inspection.answer.overlay.nodes)


def test_a_run_is_compared_with_what_its_map_was_before_it_learned(demo: SessionHarness) -> None:
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE))
    shown = follow(demo, f"{BEFORE_FIRST_QUERY}")
    assert "matched by their id" in words(shown)
    assert palette.PLAN in colours(shown)
    assert not re.search(r"believed differently: 0\b", words(shown))


def test_a_recording_to_compare_with_that_is_not_there_or_broken_is_said_in_words(demo: SessionHarness) -> None:
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE))
    demo.do(c.Ask(c.Action.TELL, "gone.rrd"))
    assert "gone.rrd" in said(demo.now)
    (demo.library.folder / "holiday.rrd").write_bytes(b"not a recording")
    shown = demo.do(c.Ask(c.Action.TELL, "holiday.rrd"), ticks=3)
    assert "holiday.rrd" in words(shown)
    assert shown.mode is Mode.REPLAY
    assert "demo-map.rrd" in words(follow(demo, "choose another"))


def test_maps_of_different_scenes_are_compared_by_metrics_alone(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    shutil.copy(DEMO_MAP, tmp_path / "demo-map.rrd")
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE))
    shown = harness.do(c.Ask(c.Action.TELL, "demo-map.rrd"), ticks=3)
    assert "different scenes" in words(shown)
    assert "the live run" in words(shown)


def test_without_truth_one_sentence_says_why(demo: SessionHarness) -> None:
    case = demo.inspector.context(demo.state, demo.now.moment)

    def outside(frame: int) -> Observation | None:
        seen = case.observation(frame)
        return seen and Observation(seen.rgb, seen.depth, seen.odometry, seen.stamp, seen.step)

    for observation in (outside, lambda _: None):
        assert "ground truth is unknown" in answer_text(
            GroundTruthQuestion().answer(replace(case, observation=observation), NOTHING_SELECTED).answer
        )


def test_without_a_model_of_the_place_true_poses_tell_which_edges_lead_elsewhere(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    graph = harness.state.live_map.graph
    count = len(graph.driven_edges)
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.TRUTH), ticks=3)
    assert f": 0 of {count} edges" in words(shown)
    edge = next(iter(graph.driven_edges.values()))
    moved = replace(edge, waypoint=edge.waypoint._replace(x_m=edge.waypoint.x_m + 0.6))
    harness.do(c.EditMap((EdgePruned(edge.source, edge.target, Cause.HAND), EdgeAdded(moved, Cause.HAND))))
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.TRUTH), ticks=3)
    assert f": 1 of {count} edges" in words(shown)
    assert "0.60" in words(shown)
    assert colours(shown) == {palette.EDGE_REMOVED}


def test_the_live_run_says_how_it_can_be_shared(tmp_path: Path) -> None:
    assert "press R" in words(SessionHarness(tmp_path).do(c.Ask(c.Action.QUESTION, QuestionName.SHARE)))


def test_the_link_leads_back_to_the_moment_and_the_edge(demo: SessionHarness) -> None:
    source, target = next(iter(demo.inspector.context(demo.state, demo.now.moment).graph.edges))
    shown = demo.do(c.Ask(c.Action.QUESTION, QuestionName.SHARE), c.PointAt(source, target), c.Seek(3.0), ticks=2)
    copied = next(each for each in pieces(shown) if isinstance(each, Copyable))
    assert copied.text in [each.url for each in pieces(shown) if isinstance(each, Address)]
    demo.do(c.Seek(0.0), c.Ask(c.Action.QUESTION, ""), c.PointAt(source))
    again = demo.do(*commands_from_link(copied.text.removeprefix("/?")), ticks=2)
    assert np.isclose(again.timeline.time_s, 3.0, atol=0.011)
    assert again.inspection.question is QuestionName.EDGE
    assert again.inspection.selection.edge == (source, target)


def test_a_link_to_a_recording_that_is_not_there_is_said_and_the_page_goes_on(demo: SessionHarness) -> None:
    shown = demo.do(*commands_from_link("replay=gone.rrd&at=3&tool=edge&edge=1-2"), ticks=3)
    assert "gone.rrd" in said(shown)
    assert shown.inspection.question is QuestionName.FIRST
    assert demo.do(c.Seek(1.0)).mode is Mode.REPLAY


@pytest.mark.slow
def test_a_moment_is_saved_twice_under_two_names_with_a_test_that_compiles(demo: SessionHarness) -> None:
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.SHARE))
    before = set(demo.library.folder.iterdir())
    shown = follow(demo, ShareAction.SAVE_EXCERPT)
    assert "moment-demo-drive" in words(shown)
    follow(demo, ShareAction.SAVE_EXCERPT)
    written = sorted(set(demo.library.folder.iterdir()) - before)
    moments, tests = [p for p in written if p.suffix == ".rrd"], [p for p in written if p.suffix == ".py"]
    assert (len(moments), len(tests)) == (2, 2)
    assert Recording.open(moments[0]).final_graph().edges == Recording.open(moments[1]).final_graph().edges
    compile(tests[0].read_text(encoding="utf-8"), str(tests[0]), "exec")
    assert sum(name in tests[0].read_text(encoding="utf-8") for name in (p.name for p in moments)) == 1


def test_the_map_is_written_as_a_page_and_a_figure_that_ask_nothing_of_others(demo: SessionHarness) -> None:
    demo.state.alignment = FloorPlanClicks(laid_room())
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.SHARE))
    shown = follow(demo, ShareAction.SAVE_MAP)
    page, figure = (
        next(demo.library.folder.glob(f"map-*{end}")).read_text(encoding="utf-8") for end in (".html", ".svg")
    )
    assert figure.startswith("<svg")
    assert '<image width="80" height="60"' in figure, "the floor plan lies under the map"
    assert not re.search(r"(src|href)=[\"']?https?:", page + figure)
    numbers = [int(re.sub(r"\D", "", each.address)) for each in pieces(shown) if isinstance(each, Download)]
    assert [demo.state.saved_files.read(number) for number in numbers] == [page.encode(), figure.encode()]
    assert demo.state.saved_files.read(numbers[0] + 1) is None


def test_rerun_is_opened_by_a_link_and_a_failure_is_said_in_words(demo: SessionHarness) -> None:
    demo.state.rerun = lambda path: f"http://127.0.0.1:1/{path.name}"
    demo.do(c.Ask(c.Action.QUESTION, QuestionName.SHARE))
    opened = follow(demo, ShareAction.OPEN_IN_RERUN)
    addresses = [each.url for each in pieces(opened) if isinstance(each, Address) and each.in_new_tab]
    assert addresses == ["http://127.0.0.1:1/demo-drive.rrd"]

    def broken(path: Path) -> str:
        raise RecordingError("no viewer here")

    demo.state.rerun = broken
    demo.do(c.Seek(1.0), ticks=2)
    failed = words(follow(demo, ShareAction.OPEN_IN_RERUN))
    assert "no viewer here" in failed
    assert ShareAction.SAVE_EXCERPT in failed
