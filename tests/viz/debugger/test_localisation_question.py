"""Where the robot might be: live, and in the demo recording."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_viz.app_setup import open_app_state
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context_builder import DebugContextBuilder
from ltvn_viz.debugger.localisation_question import LocalisationQuestion
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session import commands as c
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionName
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.run_moment import RunMoment
from tests.repository import RECORDINGS
from tests.viz.debugger.answer_links import follow
from tests.viz.session_harness import FakeDriver, SessionHarness


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """A live map of one room with the tool on show."""
    harness = SessionHarness(tmp_path)
    harness.do(c.ChooseQuestion(QuestionName.WHERE), ticks=5)
    return harness


def test_the_node_at_the_robot_is_the_best_and_the_lightest(harness: SessionHarness) -> None:
    shown = harness.wait(3)

    colours = shown.inspection.answer.overlay.nodes
    light = {node: sum(colour) for node, colour in colours.items()}
    here = next(node for node in colours if f"node {node}</a>" in shown.inspection.html)
    assert len(colours) == len(harness.state.live_map.graph.nodes)
    assert light[here] == max(light.values())
    assert "Margin <b>" in shown.inspection.html


def test_after_a_drive_the_margin_over_time_leads_to_the_least_sure_look(harness: SessionHarness) -> None:
    harness.do(c.NavigateTo(max(harness.state.live_map.graph.nodes)))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    end = harness.now.moment.stamp

    shown = harness.until(lambda snapshot: "lt-curve" in snapshot.inspection.html)
    then = follow(harness, shown, " at ")

    assert "lt-curve" in shown.inspection.html
    assert then.moment.stamp < end


def test_perceptual_aliases_are_searched_on_demand_alone(harness: SessionHarness) -> None:
    shown = follow(harness, harness.wait(3), "look alike")

    assert "perceptual aliases" in shown.inspection.html or "No two places look alike" in shown.inspection.html


def test_an_empty_map_has_nothing_to_compare_with(tmp_path: Path) -> None:
    state = SessionHarness(tmp_path, mapped=False).state

    shown = LocalisationQuestion().answer(
        DebugContextBuilder(BackgroundCache(state.worker, lambda: None)).build(state, RunMoment()), NOTHING_SELECTED
    )

    assert "The map is empty" in shown.html


@pytest.fixture
def replayed() -> Iterator[list[Snapshot]]:
    """Show the end of the demo recording to the tool, and wait for the answer."""
    with ExitStack() as stack:
        options = AppOptions(recordings=RECORDINGS, replay="demo-drive.rrd")
        state = open_app_state(options, stack, ThumbnailStore())
        shown: list[Snapshot] = []
        session = Session(state, FakeDriver(), shown.append)
        session.send(c.OpenRecording("demo-drive.rrd", at_s=150.0))
        session.send(c.ChooseQuestion(QuestionName.WHERE))
        for _ in range(40):
            session.tick()
            state.worker.settle()
        yield shown
        session.close()


@pytest.mark.slow
def test_in_the_demo_recording_images_are_read_bit_by_bit_until_all_are_compared(replayed: list[Snapshot]) -> None:
    last = replayed[-1]

    assert any("to go …" in each.inspection.html for each in replayed)
    assert "to go …" not in last.inspection.html
    assert "Margin <b>" in last.inspection.html
    assert len(last.inspection.answer.overlay.nodes) == len(last.moment.graph.ids)
