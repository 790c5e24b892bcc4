"""Planted faults are found in the recording that holds them, the way a person would."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz.options import AppOptions
from ltvn_viz.session import Session
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.staging import open_stage
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import PuppetDriver

RECORDINGS = Path(__file__).parents[2] / "recordings"
FAULTS = "demo-fault.rrd"

Do = Callable[..., Snapshot]


@pytest.fixture(scope="module")
def do() -> Iterator[Do]:
    """A session that replays the recording with faults; sends commands and returns what is shown then."""
    with ExitStack() as stack:
        stage = open_stage(AppOptions(recordings=RECORDINGS, replay=FAULTS), stack, Thumbnails())
        shown: list[Snapshot] = []
        session = Session(stage, PuppetDriver(), shown.append)

        def act(*commands: c.Command, ticks: int = 4) -> Snapshot:
            for command in commands:
                session.send(command)
            for _ in range(ticks):
                session.tick()
                stage.worker.settle()
            return shown[-1]

        act(c.OpenRecording(FAULTS))
        yield act
        session.close()


def test_playing_stops_where_the_first_leg_fails_at_the_edge_through_the_wall(do: Do) -> None:
    do(c.ChooseTool(ToolName.BREAK), c.Seek(0.0))
    do(c.Tell("failed leg"), c.Pause())

    stopped = do(ticks=90)

    assert stopped.replay is not None
    assert not stopped.replay.playing
    assert stopped.message is not None
    assert "leg 1 from 1489 to 2621 failed" in stopped.message.text
    do(c.Tell("remove all"))


def test_without_the_edge_through_the_wall_there_is_a_way_round(do: Do) -> None:
    do(c.ChooseTool(ToolName.WHAT_IF), c.Seek(1.0))

    shown = do(c.Tell("without 1489->2621"))

    assert "instead of 2 nodes" in shown.inspection.html
    do(c.Tell("forget all"))


def test_with_the_missing_edge_there_is_a_way_where_there_was_none(do: Do) -> None:
    do(c.ChooseTool(ToolName.WHAT_IF), c.Seek(1e9))

    shown = do(c.Tell("with 1158->2465"))

    assert "instead of no way" in shown.inspection.html
    do(c.Tell("forget all"))
