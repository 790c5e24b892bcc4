"""A replay shows what was shown live, at any time one likes."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ltvn_core.types import Twist
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import SessionHarness


class Recorded(NamedTuple):
    """A session that plays back what it drove, and what was shown meanwhile."""

    harness: SessionHarness
    live: list[Snapshot]


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    """Drive a little and navigate once while recording, and open the recording."""
    harness = SessionHarness(tmp_path)
    harness.do(c.Ask(c.Action.RECORD))
    begin = len(harness.shown)
    harness.driver.twist = Twist(0.3, 0.5)
    harness.wait(90)
    harness.driver.twist = None
    harness.do(c.Ask(c.Action.GOAL, int(harness.now.moment.graph.ids[-1])))
    harness.until(lambda now: now.mode is Mode.TELEOP)
    live = harness.shown[begin:]
    name = harness.now.recording.name
    assert name is not None
    harness.do(c.Ask(c.Action.KEEP))
    harness.until(lambda now: bool(now.recordings))
    harness.do(c.OpenRecording(name), ticks=2)
    assert harness.session.state.activity.mode is Mode.REPLAY
    return Recorded(harness, live)


def start_of(harness: SessionHarness) -> float:
    return harness.now.moment.stamp - harness.now.timeline.time_s if harness.now.replay is not None else 0.0


def alike(one: RunMoment, other: RunMoment) -> bool:
    return (
        np.array_equal(one.graph.ids, other.graph.ids)
        and np.array_equal(one.graph.edges, other.graph.edges)
        and np.array_equal(one.graph.p, other.graph.p)
        and np.allclose(one.graph.poses, other.graph.poses)
        and one.progress.goal == other.progress.goal
        and one.progress.plan == other.progress.plan
        and one.progress.attempt == other.progress.attempt
        and one.progress.navigator == other.progress.navigator
    )


def test_the_fold_of_a_recording_equals_what_was_shown_live(recorded: Recorded) -> None:
    harness, live = recorded
    start = start_of(harness)
    # An event carries the stamp of the tick before it, so only where nothing happens around a moment must both agree.
    trios = zip(live, live[2:], live[4:], strict=False)
    settled = [now for a, now, b in trios if alike(a.moment, now.moment) and alike(now.moment, b.moment)][::3]
    assert len(settled) > 8
    for now in settled:
        shown = harness.do(c.Seek(now.moment.stamp - start))
        assert alike(shown.moment, now.moment)


def test_a_replay_begins_where_driving_began_with_the_map_there(recorded: Recorded) -> None:
    harness, live = recorded
    assert harness.now.timeline.length_s < 120
    assert len(harness.now.moment.graph.ids) == len(live[0].moment.graph.ids)
    assert len(harness.now.moment.trajectory) <= 2


def test_playing_follows_recorded_time_and_holds_at_the_end(recorded: Recorded) -> None:
    harness = recorded.harness
    shown = harness.do(c.Ask(c.Action.PAUSE), ticks=31)
    assert shown.timeline.time_s == pytest.approx(31 / 30)
    harness.do(c.Seek(1e9))
    shown = harness.wait(3)
    assert not shown.timeline.is_playing
    assert shown.timeline.time_s == shown.timeline.length_s


def test_seeking_stays_within_the_recording(recorded: Recorded) -> None:
    harness = recorded.harness
    for time_s in (-5.0, 1e12):
        shown = harness.do(c.Seek(time_s))
        assert 0 <= shown.timeline.time_s <= shown.timeline.length_s


def test_the_robot_moves_smoothly_between_frames(recorded: Recorded) -> None:
    harness = recorded.harness
    harness.do(c.Seek(0.5), c.Ask(c.Action.PAUSE))
    places = [harness.wait().moment.robot for _ in range(30)]
    steps = np.linalg.norm(np.diff(np.array(places)[:, :2], axis=0), axis=1)
    assert (steps > 0).mean() > 0.8


def test_the_robot_stands_during_a_replay_and_drives_by_its_map_after_it(recorded: Recorded) -> None:
    harness, live = recorded
    where = harness.robot.pose.copy()
    harness.driver.twist = Twist(0.4, 0.0)
    harness.wait(30)
    np.testing.assert_array_equal(harness.robot.pose, where)
    shown = harness.do(c.Ask(c.Action.CLOSE), ticks=30)
    assert len(shown.moment.graph.ids) >= len(live[-1].moment.graph.ids)
    assert harness.session.state.activity.mode is Mode.TELEOP
    assert not np.array_equal(harness.robot.pose, where)
