"""Recordings that a session makes: never overwritten, never lost, playable at once."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.nav.events import LegEnded, LegStarted, Localised
from ltvn_core.types import Twist
from ltvn_viz import commands as c
from ltvn_viz.modes import Mode
from tests.viz.theatre import Theatre


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    theatre = Theatre(tmp_path)
    theatre.wait()
    return theatre


def record(theatre: Theatre, ticks: int = 60) -> None:
    theatre.do(c.StartRecording())
    theatre.driver.twist = Twist(0.3, 0.4)
    theatre.wait(ticks)
    theatre.driver.twist = None
    theatre.wait(2)


def test_keeping_leaves_a_finished_file_in_the_list(theatre: Theatre) -> None:
    record(theatre)
    name = theatre.now.recording.name
    assert theatre.now.recording.frames > 10
    theatre.do(c.KeepRecording())
    assert theatre.tapes[0].closed
    assert theatre.library.names() == (name,)


def test_recordings_of_the_same_second_get_names_of_their_own(theatre: Theatre) -> None:
    for _ in range(3):
        record(theatre, ticks=5)
        theatre.do(c.KeepRecording())
    assert len({tape.path for tape in theatre.tapes}) == 3
    assert len(theatre.library.names()) == 3


def test_discarding_moves_the_file_aside_and_deletes_nothing(theatre: Theatre) -> None:
    for _ in range(2):
        record(theatre, ticks=5)
        theatre.do(c.DiscardRecording())
    assert theatre.library.names() == ()
    assert len(list((theatre.library.folder / "discarded").iterdir())) == 2


def test_a_second_recording_cannot_begin_over_the_first(theatre: Theatre) -> None:
    record(theatre, ticks=5)
    shown = theatre.do(c.StartRecording())
    assert shown.message is not None
    assert "keep or discard it first" in shown.message.text
    assert len(theatre.tapes) == 1


def test_a_recording_holds_the_map_and_every_image_its_events_name(theatre: Theatre) -> None:
    record(theatre)
    goal = int(theatre.now.moment.graph.ids[-1])
    theatre.do(c.NavigateTo(goal))
    theatre.until(lambda now: now.mode is Mode.TELEOP)
    theatre.do(c.KeepRecording())
    tape = theatre.tapes[0]
    held = {seen.step for seen in tape.frames}
    looks = (Localised, LegStarted, LegEnded)
    named = {stamped.event.frame for stamped in tape.events if isinstance(stamped.event, looks)}
    assert named <= held
    assert set(theatre.stage.mapping.graph.nodes) <= held


def test_a_full_disk_ends_the_recording_keeps_the_file_and_says_so(theatre: Theatre) -> None:
    record(theatre, ticks=5)
    theatre.tapes[0].full = True
    theatre.driver.twist = Twist(0.3, 0.0)
    shown = theatre.until(lambda now: now.recording.name is None, ticks=10)
    assert shown.message is not None
    assert "No space left" in shown.message.text
    assert theatre.tapes[0].closed
    assert theatre.tapes[0].path.exists()


def test_an_unwritable_folder_is_a_clear_error(tmp_path: Path) -> None:
    blocked = tmp_path / "a file"
    blocked.write_text("in the way")
    theatre = Theatre(blocked)
    shown = theatre.do(c.StartRecording())
    assert shown.recording.name is None
    assert shown.message is not None
    assert "--recordings" in shown.message.text


def test_closing_the_app_keeps_the_recording_under_way(theatre: Theatre) -> None:
    record(theatre, ticks=5)
    theatre.session.close()
    assert theatre.tapes[0].closed
    assert theatre.library.names()


@pytest.mark.parametrize("name", ["../secret.rrd", "/etc/passwd", "discarded/x.rrd", "", "nothing.rrd", ".."])
def test_only_recordings_of_the_list_can_be_opened(theatre: Theatre, name: str) -> None:
    (theatre.library.folder.parent / "secret.rrd").touch()
    shown = theatre.do(c.OpenRecording(name), ticks=2)
    assert shown.mode is Mode.TELEOP
    assert shown.message is not None
    assert "no recording" in shown.message.text


def test_a_link_out_of_the_folder_is_not_listed(theatre: Theatre, tmp_path: Path) -> None:
    outside = tmp_path.parent / "outside.rrd"
    outside.touch()
    theatre.library.folder.mkdir(exist_ok=True)
    (theatre.library.folder / "link.rrd").symlink_to(outside)
    assert theatre.library.names() == ()


def test_an_image_that_waited_for_the_mapper_is_recorded_with_its_node(theatre: Theatre) -> None:
    theatre.driver.twist = Twist(0.5, 0.5)
    theatre.wait(20)
    theatre.do(c.StartRecording(), ticks=30)
    theatre.driver.twist = None
    theatre.do(c.KeepRecording())
    held = {seen.step for seen in theatre.tapes[0].frames}
    assert set(theatre.stage.mapping.graph.nodes) | set(theatre.stage.mapping.graph.reserve) <= held


def test_a_recording_counts_robot_time(theatre: Theatre) -> None:
    record(theatre, ticks=61)
    assert np.isclose(theatre.now.recording.seconds, 2.0, atol=0.15)
