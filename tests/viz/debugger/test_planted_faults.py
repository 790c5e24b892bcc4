"""Planted faults are found in the recording that holds them, the way a person would."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.repository import RECORDINGS
from tests.viz.debugger.answer_links import links, words
from tests.viz.session_harness import FakeDriver

FAULTS = "demo-fault.rrd"

Do = Callable[..., Snapshot]


@pytest.fixture
def do() -> Iterator[Do]:
    """A session that replays the recording with faults; sends commands and returns what is shown then."""
    with ExitStack() as stack:
        state = open_app_state(AppOptions(recordings=RECORDINGS, replay=FAULTS), stack, ThumbnailStore())
        shown: list[Snapshot] = []
        session = Session(state, FakeDriver(), shown.append)

        def act(*commands: c.Command, ticks: int = 4) -> Snapshot:
            for command in commands:
                session.send(command)
            for _ in range(ticks):
                session.tick()
                state.worker.settle()
            return shown[-1]

        act(c.OpenRecording(FAULTS))
        yield act
        session.close()


def test_playing_stops_where_the_first_attempt_fails_at_the_edge_through_the_wall(do: Do) -> None:
    offered = do(c.ChooseQuestion(QuestionName.BREAK), c.Seek(0.0))
    do(c.FollowLink(next(number for number, label in links(offered) if label == "failed leg")), c.Pause())

    stopped = do(ticks=90)

    assert stopped.replay is not None
    assert not stopped.replay.playing
    assert stopped.message is not None
    assert "attempt 1 along edge 1489 → 2621 failed" in stopped.message.text


def test_an_edge_that_is_selected_among_the_failures_is_named_there(do: Do) -> None:
    do(c.ChooseQuestion(QuestionName.FAILURES), c.Seek(20.1))
    shown = do(c.PointAt(3081, 2226))
    assert "3081 → 2226: its images and attempts" in words(shown)
    assert {3081, 2226} <= shown.inspection.answer.overlay.nodes.keys()


def test_without_the_edge_through_the_wall_there_is_a_way_round(do: Do) -> None:
    do(c.ChooseQuestion(QuestionName.WHAT_IF), c.Seek(1.0))

    shown = do(c.SubmitText("without 1489->2621"))

    assert "instead of 2 nodes" in words(shown)


def test_with_the_missing_edge_there_is_a_way_where_there_was_none(do: Do) -> None:
    do(c.ChooseQuestion(QuestionName.WHAT_IF), c.Seek(1e9))

    shown = do(c.SubmitText("with 1158->2465"))

    assert "instead of no way" in words(shown)
