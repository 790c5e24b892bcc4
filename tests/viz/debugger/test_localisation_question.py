"""Where the robot might be: live, and in the demo recording."""

import re
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from ltvn_core.analysis.answer import StepChart
from ltvn_core.analysis.answer_text import answer_text
from ltvn_core.graph.corrections import UnsurePlaces
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.localisation_question import LocalisationQuestion
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.repository import DEMO_DRIVE, RECORDINGS
from tests.viz.app_session import AppSession
from tests.viz.debugger.answer_links import follow, words
from tests.viz.session_harness import SessionHarness


@pytest.fixture
def harness(harness: SessionHarness) -> SessionHarness:
    """A live map of one room with the tool on show."""
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.WHERE), ticks=5)
    return harness


def test_the_node_at_the_robot_is_the_best_and_the_lightest(harness: SessionHarness) -> None:
    shown = harness.wait(3)
    colours = shown.inspection.answer.overlay.nodes
    light = {node: sum(colour) for node, colour in colours.items()}
    here = next(each.node for each in shown.inspection.answer.links if isinstance(each, c.PointAt))
    assert len(colours) == len(harness.state.live_map.graph.nodes)
    assert light[here] == max(light.values())
    near = re.search(r"(\d+) (nodes?) near enough", words(shown))
    assert near is not None
    assert (near[1] == "1") == (near[2] == "node")


def test_after_a_drive_the_margin_over_time_leads_to_the_least_sure_look(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, max(harness.state.live_map.graph.nodes)))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    end = harness.now.moment.stamp
    shown = harness.until(lambda snapshot: "Smallest" in words(snapshot))
    then = follow(harness, shown, " at ")
    curve = next(each for each in shown.inspection.answer.answer.blocks if isinstance(each, StepChart))
    assert len(curve.points) > 1
    assert then.moment.stamp < end


def test_perceptual_aliases_are_searched_on_demand_alone(harness: SessionHarness) -> None:
    shown = follow(harness, harness.wait(3), "look alike")
    assert "perceptual aliases" in words(shown).lower()


def test_places_that_a_map_knows_to_look_alike_are_joined_without_a_search(harness: SessionHarness) -> None:
    first, *_, last = harness.state.live_map.graph.nodes
    context = Inspector((), harness.state.worker).context(harness.state, harness.now.moment)
    known = replace(context, unsure=UnsurePlaces(0.4, (first, last), ((first, last, 3),)))
    shown = LocalisationQuestion().answer(known, NOTHING_SELECTED)
    assert f"{first} and {last}" in answer_text(shown.answer)
    assert len(shown.overlay.strokes) == 1


def test_an_empty_map_has_nothing_to_compare_with(tmp_path: Path) -> None:
    state = SessionHarness(tmp_path, mapped=False).state
    shown = LocalisationQuestion().answer(Inspector((), state.worker).context(state, RunMoment()), NOTHING_SELECTED)
    assert "The map is empty" in answer_text(shown.answer)


@pytest.mark.slow
def test_in_the_demo_recording_images_are_read_bit_by_bit_until_all_are_compared() -> None:
    with ExitStack() as stack:
        page = AppSession(stack, AppOptions(recordings=RECORDINGS, replay=DEMO_DRIVE.name))
        page.do(c.OpenRecording(DEMO_DRIVE.name, at_s=150.0), c.Ask(c.Action.QUESTION, QuestionName.WHERE), ticks=40)
    replayed = page.shown
    last = replayed[-1]
    reading = [each for each in replayed if "left …" in words(each)]
    assert reading
    assert not any("near enough" in words(each) or "may be here" in words(each) for each in reading)
    assert not any(each.inspection.answer.overlay.nodes for each in reading)
    assert "left …" not in words(last)
    assert "near enough" in words(last)
    assert len(last.inspection.answer.overlay.nodes) == len(last.moment.graph.ids)
