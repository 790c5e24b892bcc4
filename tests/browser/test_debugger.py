"""The eleven tools of the “Why” tab as a person uses them, in a real browser, on a good run and on one with faults.

The faults were planted in a good map: an edge through a wall, an edge between look-alike places, missing edges. The
tests know none of them beforehand; they follow links from “it failed” to the edge that is to blame.
"""

import re
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import pytest
from playwright.sync_api import Browser

from ltvn_core.data.recording.reader import Recording
from ltvn_viz.session.inspection import QuestionName
from tests.browser.debugger_page import DebuggerPage, open_debugger
from tests.repository import DEMO_FAULT
from tests.waiting import PATIENCE_S

Faults: TypeAlias = dict[str, set[tuple[int, int]]]
"""Planted edges by kind."""

pytestmark = pytest.mark.browser

SEARCH_S = 3 * PATIENCE_S
"""All pairs of a map's images are compared, which keeps a processor busy for a minute where it has nothing else."""


@pytest.fixture(scope="module")
def fault_page(chromium: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[DebuggerPage]:
    """A page on the recording with planted faults, and wherever the tests before have led it."""
    with open_debugger(chromium, tmp_path_factory.mktemp("recordings"), "demo-fault.rrd", draws=False) as debugger:
        yield debugger


@pytest.fixture
def fault(fault_page: DebuggerPage) -> DebuggerPage:
    """A page on the recording with planted faults."""
    fault_page.go_to_the_recording("demo-fault.rrd")
    return fault_page


@pytest.fixture(scope="module")
def planted() -> Faults:
    """Return the planted edges by kind, as the recording's own settings tell them."""
    found: Faults = {}
    for each in Recording.open(DEMO_FAULT).meta.config["faults"]:
        found.setdefault(each["kind"], set()).update((source, target) for source, target in each["edges"])
    return found


def edges_in(text: str) -> list[tuple[int, int]]:
    """Return the edges that a text names, in its order."""
    return [(int(source), int(target)) for source, target in re.findall(r"(\d+) → (\d+)", text)]


def test_a_failed_query_leads_to_the_edge_through_the_wall(fault: DebuggerPage, planted: Faults) -> None:
    told = fault.go_to_failure(0)
    assert "step limit" in told
    fault.follow(re.compile("^edge "))
    edge = fault.shown.selection.edge
    assert edge in planted["spurious-edge"]
    attempts = fault.ask(QuestionName.EDGE)
    assert f"planned 1 edge to {edge[1]}" in fault.says("Why was it chosen?", "The best path without it costs")
    fault.says("Predicted: ")
    assert attempts.locator("figure img").count() == 2
    assert attempts.get_by_text("under way").count() == 1  # How it ends is not known at this moment.
    fault.ask(QuestionName.TRUTH)
    fault.says("precision")
    spurious = fault.answer.locator("table").first.inner_text()
    assert "cannot be driven" in spurious
    assert f"{edge[0]} → {edge[1]}" in spurious


def test_a_wrong_arrival_leads_to_the_pair_of_perceptual_aliases(fault: DebuggerPage, planted: Faults) -> None:
    assert "wrong arrival" in fault.go_to_failure(2)
    fault.follow(re.compile("^edge "))
    edge = fault.shown.selection.edge
    assert edge in planted["look-alike"]
    fault.follow(QuestionName.EDGE)
    fault.says("Predicted: ")
    assert fault.answer.locator("figure img").count() == 2
    fault.ask(QuestionName.WHERE)
    fault.says("near enough")
    fault.follow(re.compile("^search for places"))
    told = fault.says("pairs of perceptual aliases", "an edge joins them", patience_s=SEARCH_S)
    assert f"{min(edge)} ↔ {max(edge)}" in told
    fault.follow(f"{min(edge)} ↔ {max(edge)}")
    assert fault.shown.selection.edge == (min(edge), max(edge))


def test_no_path_leads_to_an_edge_that_is_missing(fault: DebuggerPage, planted: Faults) -> None:
    assert "no path" in fault.go_to_failure(3)
    fault.follow(QuestionName.TRUTH)
    fault.says("missing", "path in the map")
    listed = edges_in(fault.answer.locator("table").nth(1).inner_text())
    missing = next(edge for edge in listed if edge in planted["missing-edge"])
    fault.follow(f"{missing[0]} → {missing[1]}")
    fault.ask(QuestionName.WHAT_IF)
    fault.follow(f"with {missing[0]}->{missing[1]}")
    fault.says("with ", "forget")
    fault.follow("forget")


def test_the_history_leads_to_the_prune(fault: DebuggerPage) -> None:
    fault.go_to_failure(0)
    fault.ask(QuestionName.TIME)
    row = fault.answer.locator("tr", has_text="pruned")
    row.locator("a", has_text="›").click()
    fault.until(lambda: fault.seconds > 9)
    fault.says("pruned (attempt)")
    assert fault.seconds == pytest.approx(9.6, abs=0.2)


def test_the_map_is_compared_with_the_good_one(fault: DebuggerPage, planted: Faults) -> None:
    fault.compare_with("demo-map.rrd")
    told = fault.says("nodes", "edges", "pieces")
    differing = {*edges_in(told)}
    assert differing & planted["look-alike"], told
    assert differing & planted["missing-edge"], told
    fault.follow("choose another")


def test_a_moment_is_saved_for_somebody_else(fault: DebuggerPage) -> None:
    fault.go_to_failure(2)
    fault.ask(QuestionName.SHARE)
    fault.follow("save this moment")
    assert "Written: " in fault.says("Written: ")
    (saved,) = fault.folder.glob("moment-*.rrd")
    assert Recording.open(saved).events
    assert [*fault.folder.glob("test_moment_*.py")]


def test_a_link_shows_the_moment_and_the_edge(fault: DebuggerPage) -> None:
    fault.go_to_failure(2)
    fault.follow(re.compile("^edge "))
    edge, seconds = fault.shown.selection.edge, fault.seconds
    fault.ask(QuestionName.SHARE)
    address = fault.link_to_share("tool=edge")
    fault.go_to_failure(0)

    fault.open_link(address)

    fault.until(lambda: fault.shown.selection.edge == edge and fault.shown.question is QuestionName.EDGE)
    assert fault.seconds == pytest.approx(seconds, abs=0.01)


def test_what_only_helps_live_is_offered_at_the_robot_alone(fault: DebuggerPage) -> None:
    assert {QuestionName.COACH, QuestionName.HAND}.isdisjoint(fault.questions())
    fault.ask(QuestionName.TIME)  # The question on show stays on offer.
    fault.go_to_the_robot()
    fault.until(lambda: QuestionName.SHARE not in fault.questions())
    fault.ask(QuestionName.COACH)
    assert "piece" in fault.says("% new")


def test_the_coach_goes_along_while_somebody_drives(fault: DebuggerPage) -> None:
    """The keys drive although the list of questions was used last."""
    fault.go_to_the_robot()
    robot = fault.app.session.state.live.robot
    fault.ask(QuestionName.BREAK)
    fault.ask(QuestionName.COACH)
    before, start = advice(fault.says("% new")), robot.drawn_pose[:2].copy()

    fault.drive("w", lambda: float(np.hypot(*(robot.drawn_pose[:2] - start))) > 0.4)
    fault.drive("a", lambda: all(now != then for now, then in zip(advice(fault.shown.html), before, strict=True)))

    told = advice(fault.says("% new"))
    assert told[0] != before[0]
    assert fault.shown.answer.overlay.ghosts


def advice(html: str) -> tuple[str, str]:
    """Return the coach's hint and how new it says the view is."""
    text = re.sub(r"<[^>]+>", "\n", html)
    hint, novelty = text.strip().split("\n")[0], re.search(r"view is (\d+%) new", text)
    assert novelty, text
    return hint, novelty[1]


def test_an_edge_is_cut_and_put_back_by_hand(fault: DebuggerPage) -> None:
    fault.go_to_the_robot()
    edges = fault.app.session.state.live_map.graph.edges
    before = len(edges)
    fault.cut_what_differs("demo-fault.rrd")
    assert len(edges) == before - 1
    fault.follow("undo")
    fault.until(lambda: len(edges) == before)


@pytest.fixture(scope="module")
def drive(chromium: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[DebuggerPage]:
    """The good recording."""
    with open_debugger(
        chromium, tmp_path_factory.mktemp("recordings"), "demo-drive.rrd", at_s=175.0, draws=False
    ) as debugger:
        yield debugger


def test_on_a_good_run_every_question_has_an_answer(drive: DebuggerPage) -> None:
    offered = drive.questions()
    assert len(offered) > 7
    for question in offered:
        assert drive.ask(question).inner_text().strip(), question
    assert drive.app.session.state.message is None


def test_a_good_run_opens_in_rerun_from_the_page(drive: DebuggerPage) -> None:
    drive.ask(QuestionName.SHARE)
    drive.follow("open in Rerun")
    drive.says("Rerun is open here")
    link = drive.answer.get_by_text("Rerun is open here")
    assert (link.get_attribute("href") or "").startswith("http://127.0.0.1:")
