"""Where the robot might be: live, and in the demo recording."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz.modes import Mode
from ltvn_viz.options import AppOptions
from ltvn_viz.session import Session
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.staging import open_stage
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.timeline import Moment
from ltvn_viz.why.tool import NOWHERE, ToolName
from ltvn_viz.why.where import WhereTool
from tests.viz.theatre import PuppetDriver, Theatre
from tests.viz.why_links import follow

RECORDINGS = Path(__file__).parents[2] / "recordings"


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    """A live map of one room with the tool on show."""
    theatre = Theatre(tmp_path)
    theatre.do(c.ChooseTool(ToolName.WHERE), ticks=5)
    return theatre


def test_the_node_at_the_robot_is_the_best_and_the_bluest(theatre: Theatre) -> None:
    shown = theatre.wait(3)

    colours = shown.inspection.view.overlay.nodes
    blue = {node: colour.blue - colour.red for node, colour in colours.items()}
    here = next(node for node in colours if f"node {node}</a>" in shown.inspection.html)
    assert len(colours) == len(theatre.stage.mapping.graph.nodes)
    assert blue[here] == max(blue.values())
    assert "Margin <b>" in shown.inspection.html


def test_after_a_drive_the_margin_over_time_leads_to_the_least_sure_look(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(max(theatre.stage.mapping.graph.nodes)))
    theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    end = theatre.now.moment.stamp

    shown = theatre.until(lambda snapshot: "lt-curve" in snapshot.inspection.html)
    then = follow(theatre, shown, " at ")

    assert "lt-curve" in shown.inspection.html
    assert then.moment.stamp < end


def test_look_alikes_are_searched_on_demand_alone(theatre: Theatre) -> None:
    shown = follow(theatre, theatre.wait(3), "look alike")

    assert "look-alike pairs" in shown.inspection.html or "No two places look alike" in shown.inspection.html


def test_an_empty_map_has_nothing_to_compare_with(tmp_path: Path) -> None:
    stage = Theatre(tmp_path, mapped=False).stage

    shown = WhereTool().look(stage.cases.of(stage, Moment()), NOWHERE)

    assert "The map is empty" in shown.html


@pytest.fixture
def replayed() -> Iterator[list[Snapshot]]:
    """Show the end of the demo recording to the tool, and wait for the answer."""
    with ExitStack() as stack:
        options = AppOptions(recordings=RECORDINGS, replay="demo-drive.rrd")
        stage = open_stage(options, stack, Thumbnails())
        shown: list[Snapshot] = []
        session = Session(stage, PuppetDriver(), shown.append)
        session.send(c.OpenRecording("demo-drive.rrd", at_s=150.0))
        session.send(c.ChooseTool(ToolName.WHERE))
        for _ in range(40):
            session.tick()
            stage.worker.settle()
        yield shown
        session.close()


def test_in_the_demo_recording_images_are_read_bit_by_bit_until_all_are_compared(replayed: list[Snapshot]) -> None:
    last = replayed[-1]

    assert any("to go …" in each.inspection.html for each in replayed)
    assert "to go …" not in last.inspection.html
    assert "Margin <b>" in last.inspection.html
    assert len(last.inspection.view.overlay.nodes) == len(last.moment.graph.ids)
