"""A replay shows what was shown live, at any time one likes."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.types import Twist
from ltvn_viz import commands as c
from ltvn_viz.modes import Mode
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.timeline import Moment
from tests.viz.theatre import Theatre


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Theatre, list[Snapshot], str]:
    """Drive a little and navigate once while recording; returns what was shown meanwhile and the file's name."""
    theatre = Theatre(tmp_path)
    theatre.do(c.StartRecording())
    begin = len(theatre.shown)
    theatre.driver.twist = Twist(0.3, 0.5)
    theatre.wait(90)
    theatre.driver.twist = None
    theatre.do(c.NavigateTo(int(theatre.now.moment.graph.ids[-1])))
    theatre.until(lambda now: now.mode is Mode.TELEOP)
    live = theatre.shown[begin:]
    name = theatre.now.recording.name
    assert name is not None
    theatre.do(c.KeepRecording())
    theatre.until(lambda now: bool(now.recordings), ticks=90_000)
    theatre.do(c.OpenRecording(name), ticks=2)
    assert theatre.session.mode is Mode.REPLAY
    return theatre, live, name


def start_of(theatre: Theatre) -> float:
    return theatre.now.moment.stamp - theatre.now.replay.time_s if theatre.now.replay is not None else 0.0


def alike(one: Moment, other: Moment) -> bool:
    return (
        np.array_equal(one.graph.ids, other.graph.ids)
        and np.array_equal(one.graph.edges, other.graph.edges)
        and np.array_equal(one.graph.p, other.graph.p)
        and np.allclose(one.graph.poses, other.graph.poses)
        and one.progress.goal == other.progress.goal
        and one.progress.plan == other.progress.plan
        and one.progress.leg == other.progress.leg
        and one.progress.navigator == other.progress.navigator
    )


def test_the_fold_of_a_recording_equals_what_was_shown_live(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, live, _ = recorded
    start = start_of(theatre)
    # An event carries the stamp of the tick before it, so only where nothing happens around a moment must both agree.
    trios = zip(live, live[2:], live[4:], strict=False)
    settled = [now for a, now, b in trios if alike(a.moment, now.moment) and alike(now.moment, b.moment)][::3]
    assert len(settled) > 8
    for now in settled:
        shown = theatre.do(c.Seek(now.moment.stamp - start))
        assert alike(shown.moment, now.moment)


def test_a_replay_begins_where_driving_began_with_the_map_there(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, live, _ = recorded
    assert theatre.now.replay is not None
    assert theatre.now.replay.length_s < 120
    assert len(theatre.now.moment.graph.ids) == len(live[0].moment.graph.ids)
    assert len(theatre.now.moment.trajectory) <= 2


def test_playing_follows_recorded_time_and_holds_at_the_end(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, _, _ = recorded
    shown = theatre.do(c.Pause(), ticks=31)
    assert shown.replay is not None
    assert shown.replay.time_s == pytest.approx(31 / 30)
    theatre.do(c.Seek(1e9))
    shown = theatre.wait(3)
    assert shown.replay is not None
    assert not shown.replay.playing
    assert shown.replay.time_s == shown.replay.length_s


def test_seeking_stays_within_the_recording(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, _, _ = recorded
    for time_s in (-5.0, 1e12):
        shown = theatre.do(c.Seek(time_s))
        assert shown.replay is not None
        assert 0 <= shown.replay.time_s <= shown.replay.length_s


def test_the_robot_moves_smoothly_between_frames(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, _, _ = recorded
    theatre.do(c.Seek(0.5), c.Pause())
    places = [theatre.wait().moment.robot for _ in range(30)]
    steps = np.linalg.norm(np.diff(np.array(places)[:, :2], axis=0), axis=1)
    assert (steps > 0).mean() > 0.8


def test_the_camera_shows_the_recorded_picture(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, _, _ = recorded
    assert theatre.do(c.Seek(2.0)).camera is not None


def test_the_robot_stands_during_a_replay_and_drives_after_it(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, _, _ = recorded
    where = theatre.robot.pose.copy()
    theatre.driver.twist = Twist(0.4, 0.0)
    theatre.wait(30)
    np.testing.assert_array_equal(theatre.robot.pose, where)
    theatre.do(c.CloseRecording(), ticks=30)
    assert theatre.session.mode is Mode.TELEOP
    assert not np.array_equal(theatre.robot.pose, where)


def test_the_live_map_is_still_there_after_a_replay(recorded: tuple[Theatre, list[Snapshot], str]) -> None:
    theatre, live, _ = recorded
    shown = theatre.do(c.CloseRecording())
    assert len(shown.moment.graph.ids) >= len(live[-1].moment.graph.ids)
