"""Driving on with a map that was made before: the robot's odometry is another, and the map knows where drives begin."""

from pathlib import Path

from ltvn_core.types import Twist
from tests.viz.session_harness import SessionHarness

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
