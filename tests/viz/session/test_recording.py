"""Recordings that a session makes: never overwritten, never lost, playable at once."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Localised
from ltvn_core.types import Twist
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import SessionHarness, said


def record(harness: SessionHarness, ticks: int = 60) -> None:
    harness.do(c.Ask(c.Action.RECORD))
    harness.driver.twist = Twist(0.3, 0.4)
    harness.wait(ticks)
    harness.driver.twist = None
    harness.wait(2)


def test_keeping_leaves_a_finished_file_in_the_list(harness: SessionHarness) -> None:
    record(harness)
    name = harness.now.recording.name
    assert name is not None
    assert harness.now.recording.frames > 10
    harness.do(c.Ask(c.Action.KEEP))
    assert harness.writers[0].closed
    assert harness.library.names() == (name,)
    size_mb = (harness.library.folder / name).stat().st_size / 1e6
    assert harness.library.words()[name].endswith(f"{size_mb:.1f} MB")


def test_recordings_of_the_same_second_get_names_of_their_own(harness: SessionHarness) -> None:
    for _ in range(3):
        record(harness, ticks=5)
        harness.do(c.Ask(c.Action.KEEP))
    assert len({writer.path for writer in harness.writers}) == 3
    assert len(harness.library.names()) == 3


def test_discarding_moves_the_file_aside_and_deletes_nothing(harness: SessionHarness) -> None:
    for _ in range(2):
        record(harness, ticks=5)
        harness.do(c.Ask(c.Action.DISCARD))
    assert harness.library.names() == ()
    assert len(list((harness.library.folder / "discarded").iterdir())) == 2


def test_a_second_recording_cannot_begin_over_the_first(harness: SessionHarness) -> None:
    record(harness, ticks=5)
    shown = harness.do(c.Ask(c.Action.RECORD))
    assert "keep or discard it first" in said(shown)
    assert len(harness.writers) == 1


def test_a_recording_holds_the_map_and_every_image_its_events_name(harness: SessionHarness) -> None:
    record(harness)
    goal = int(harness.now.moment.graph.ids[-1])
    harness.do(c.Ask(c.Action.GOAL, goal))
    harness.until(lambda now: now.mode is Mode.TELEOP)
    harness.do(c.Ask(c.Action.KEEP))
    writer = harness.writers[0]
    held = {seen.step for seen in writer.frames}
    looks = (Localised, AttemptStarted, AttemptEnded)
    named = {stamped.event.frame for stamped in writer.events if isinstance(stamped.event, looks)}
    assert named <= held
    assert set(harness.state.live_map.graph.nodes) <= held


def test_an_unwritable_folder_is_a_clear_error(tmp_path: Path) -> None:
    blocked = tmp_path / "a file"
    blocked.write_text("in the way", encoding="utf-8")
    harness = SessionHarness(blocked)
    shown = harness.do(c.Ask(c.Action.RECORD))
    assert shown.recording.name is None
    assert "--recordings" in said(shown)


def test_closing_the_app_keeps_the_recording_under_way(harness: SessionHarness) -> None:
    record(harness, ticks=5)
    harness.session.close()
    assert harness.writers[0].closed
    assert harness.library.names()


@pytest.mark.parametrize("name", ["../secret.rrd", "/etc/passwd", "discarded/x.rrd", "", "nothing.rrd", ".."])
def test_only_recordings_of_the_list_can_be_opened(harness: SessionHarness, name: str) -> None:
    (harness.library.folder.parent / "secret.rrd").touch()
    shown = harness.do(c.OpenRecording(name), ticks=2)
    assert shown.mode is Mode.TELEOP
    assert "no recording" in said(shown)


def test_a_link_out_of_the_folder_is_not_listed(harness: SessionHarness, tmp_path: Path) -> None:
    outside = tmp_path.parent / "outside.rrd"
    outside.touch()
    harness.library.folder.mkdir(exist_ok=True)
    (harness.library.folder / "link.rrd").symlink_to(outside)
    assert harness.library.names() == ()


def test_an_image_that_waited_for_the_mapper_is_recorded_with_its_node(harness: SessionHarness) -> None:
    harness.driver.twist = Twist(0.5, 0.5)
    harness.wait(20)
    harness.do(c.Ask(c.Action.RECORD), ticks=30)
    harness.driver.twist = None
    harness.do(c.Ask(c.Action.KEEP))
    held = {seen.step for seen in harness.writers[0].frames}
    assert set(harness.state.live_map.graph.nodes) | set(harness.state.live_map.graph.reserve) <= held


def test_a_recording_counts_robot_time(harness: SessionHarness) -> None:
    record(harness, ticks=61)
    assert np.isclose(harness.now.recording.seconds, 2.0, atol=0.15)


FORWARD = Twist(0.4, 0.0)


def drive(harness: SessionHarness, ticks: int) -> None:
    """Drive ahead."""
    harness.driver.twist = FORWARD
    harness.wait(ticks)
    harness.driver.twist = None
    harness.wait(2)


def test_a_drive_with_a_loaded_map_is_another_drive_of_it(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    live_map = harness.state.live_map
    before = max(live_map.keyframes.frames)
    assert not live_map.graph.drives
    drive(harness, 60)
    (first,) = live_map.graph.drives
    assert first == before + 1
    assert harness.state.live.timeline.graph_at().drives == live_map.graph.drives
    assert max(live_map.keyframes.temporal_window(before, 5), default=0) <= before
    drive(harness, 30)
    assert len(live_map.graph.drives) == 1


def test_a_robot_that_was_put_down_elsewhere_begins_another_drive(harness: SessionHarness) -> None:
    drive(harness, 40)
    harness.robot.put_down((3.0, 3.0, 0.0), odometry=(-9.0, 2.0, 1.0))
    drive(harness, 40)
    assert len(harness.state.live_map.graph.drives) == 2


def test_a_rebuilt_map_keeps_its_drives(harness: SessionHarness) -> None:
    drive(harness, 60)
    drives = dict(harness.state.live_map.graph.drives)
    harness.state.live_map.rebuild(lambda _done, _total: None)
    assert harness.state.live_map.graph.drives == drives
