"""What becomes of a query when nobody is there to watch it."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from ltvn_viz.server.driver_seat import IDLE_S, Absence, DriverSeat, Loss
from ltvn_viz.session.command_handlers import handle
from ltvn_viz.session.session_loop import Session
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.server.test_driver_seat import ANN, BOB, Clock
from tests.viz.session_harness import SessionHarness, said

CLOSED = Absence(Loss.CLOSED, datetime(2030, 1, 2, 14, 3))


class Pages:
    """Are there until a test says otherwise."""

    absence: Absence | None = None


@pytest.fixture
def pages() -> Pages:
    return Pages()


@pytest.fixture
def harness(tmp_path: Path, pages: Pages) -> SessionHarness:
    harness = SessionHarness(tmp_path)
    harness.session = Session(harness.state, harness.driver, harness.shown.append, absence=lambda: pages.absence)
    harness.wait()
    return harness


def test_a_query_stands_at_once_and_goes_on_only_when_told(harness: SessionHarness, pages: Pages) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=20)
    pages.absence = CLOSED
    shown = harness.wait()
    where = harness.robot.pose.copy()
    assert shown.mode is Mode.PAUSED
    assert shown.pause_notice == "Paused: the last page was closed at 14:03."
    assert shown.hint.startswith("Paused: the last page was closed at 14:03. Press “Go on”")
    pages.absence = None
    assert harness.wait(60).mode is Mode.PAUSED
    assert np.array_equal(harness.robot.pose, where)
    assert harness.do(c.Ask(c.Action.PAUSE)).pause_notice == ""
    assert harness.until(lambda now: now.mode is Mode.TELEOP).moment.progress.reached == 1


def test_a_query_that_begins_with_nobody_there_stands(harness: SessionHarness, pages: Pages) -> None:
    where = harness.robot.pose.copy()
    pages.absence = CLOSED
    assert harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=30).mode is Mode.PAUSED
    assert harness.do(c.Ask(c.Action.PAUSE), ticks=30).mode is Mode.PAUSED
    assert np.array_equal(harness.robot.pose, where)


def test_a_held_query_can_be_cancelled_stepped_and_stopped(harness: SessionHarness, pages: Pages) -> None:
    for ending in (c.Ask(c.Action.CANCEL), c.Ask(c.Action.STOP)):
        harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=20)
        pages.absence = CLOSED
        harness.wait()
        pages.absence = None
        step = harness.robot.step
        harness.do(c.Ask(c.Action.STEP))
        harness.until(lambda now, before=step: now.mode is Mode.PAUSED and harness.robot.step > before)
        harness.do(ending)
        assert harness.until(lambda now: now.mode is Mode.TELEOP).pause_notice == ""


def test_a_long_run_in_simulation_may_go_on_and_that_is_off_until_asked_for(
    harness: SessionHarness, pages: Pages
) -> None:
    assert harness.now.keeps_going is False
    harness.do(c.Ask(c.Action.KEEP_GOING, 1), c.Ask(c.Action.GOAL, harness.far_node), ticks=5)
    pages.absence = CLOSED
    assert harness.now.keeps_going is True
    assert harness.until(lambda now: now.mode is Mode.TELEOP).moment.progress.reached == 1


def test_a_real_robot_never_goes_on_with_nobody_there(harness: SessionHarness) -> None:
    vars(harness.robot.clock)["is_simulated"] = False
    handle(harness.state, c.Ask(c.Action.KEEP_GOING, 1))
    assert not harness.state.keeps_going
    assert "needs a person" in said(harness.state)


def test_whoever_started_a_query_keeps_the_seat_while_it_goes_on() -> None:
    clock = Clock()
    seat = DriverSeat(clock=clock)
    assert seat.try_sit(ANN)
    seat.keep(kept=True)
    clock.wait(10 * IDLE_S)
    assert not seat.try_sit(BOB)
    seat.keep(kept=False)
    clock.wait(IDLE_S - 1)
    assert not seat.try_sit(BOB)
    clock.wait(2)
    assert seat.try_sit(BOB)
