"""A robot that no simulator knows: its time passes by itself, and nobody knows where it really is."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from ltvn_core.data.importing.played_drive import NamedDrive, play_drive
from ltvn_core.navigation.events import Judged, Localised, Note, Outcome
from ltvn_core.robots.drive_lease import DriveLease
from ltvn_core.robots.robot import WallClock
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import CONTROL_STEP_S, Features, Observation, RobotState, Twist
from ltvn_viz.panels.status_panel import Health, health_of
from ltvn_viz.session.live_run import TICK_S, LiveRobot
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.snapshot_builder import hint
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.data.importing.rosbag.bag_examples import straight_drive
from tests.core.flat_world import FlatPredictor, FlatRobot, observation_at
from tests.viz.session_harness import ONE_ROOM, InlineExecutor, SessionHarness, said
from tests.waiting import until

TURN = Twist(0.0, 0.8)
AHEAD = Twist(0.4, 0.0)


class OwnRobot:
    """Drives through the single room as the wall's time passes, which the test decides. Implements `Robot`."""

    spec = replace(LOCOBOT, name="own robot", radius_m=0.2)

    def __init__(self) -> None:
        self.now_s = 0.0
        self.clock = WallClock(lambda: self.now_s, _wait)
        self.body = FlatRobot(ONE_ROOM, (1.0, 1.0, 0.0))
        self.lease = DriveLease(self.clock.now)

    def pass_time(self, duration_s: float) -> None:
        self.now_s += duration_s
        while (self.body.step + 1) * CONTROL_STEP_S <= self.now_s + 1e-9:
            self.body.twist = self.lease.command()
            self.body.advance()

    def observe(self) -> Observation:
        return replace(observation_at(self.body.pose, self.body.step), exact_pose=None, stamp=self.now_s)

    def state(self) -> RobotState:
        bumped = self.body.state().bumper_pressed
        return RobotState(self.body.pose.copy(), self.now_s, self.body.step, bumper_pressed=bumped)

    def drive(self, twist: Twist) -> None:
        self.lease.grant(twist)

    def stop(self) -> None:
        self.lease.cancel()


class SlowPredictor(FlatPredictor):
    """Knows the room by odometry, and takes its time over every image."""

    def __init__(self, robot: OwnRobot, thought_s: float) -> None:
        super().__init__(ONE_ROOM)
        self.robot, self.thought_s = robot, thought_s

    def encode(self, observations: Sequence[Observation]) -> Features:
        self.robot.pass_time(self.thought_s)
        return np.array([[*seen.odometry, seen.step] for seen in observations])


class OwnRobotSession(SessionHarness):
    """A session with such a robot and an empty map; the wall's time passes between its ticks."""

    def __init__(self, folder: Path, *, thought_s: float = 0.0) -> None:
        self.own = OwnRobot()
        predictor = SlowPredictor(self.own, thought_s)
        super().__init__(folder, mapped=False, own_robot=self.own, predictor=predictor, executor=InlineExecutor())

    def wait(self, ticks: int = 1) -> Snapshot:
        for _ in range(ticks):
            self.own.pass_time(TICK_S)
            super().wait()
        return self.now

    def drive(self, twist: Twist, seconds: float) -> None:
        self.driver.twist = twist
        self.wait(round(seconds / TICK_S))
        self.driver.twist = None
        self.wait(2)


def _wait(duration_s: float) -> NoReturn:
    raise AssertionError(f"the session waited for the wall's clock, {duration_s} s")


@pytest.fixture
def harness(tmp_path: Path) -> OwnRobotSession:
    harness = OwnRobotSession(tmp_path)
    harness.wait()
    return harness


def explore(harness: OwnRobotSession) -> None:
    """Look around at both ends of a way of 1.6 m."""
    harness.drive(TURN, 8)
    harness.drive(AHEAD, 4)
    harness.drive(TURN, 8)


def far_node(harness: OwnRobotSession) -> int:
    graph = harness.now.moment.graph
    return int(graph.ids[np.argmax(np.linalg.norm(graph.poses[:, :2] - harness.own.body.pose[:2], axis=1))])


def test_a_held_key_drives_it_and_the_page_draws_it_where_its_odometry_says(harness: OwnRobotSession) -> None:
    before = harness.own.body.pose.copy()
    harness.drive(AHEAD, 1.0)
    assert harness.own.body.pose[0] > before[0] + 0.2
    drawn = harness.wait().moment.robot
    assert drawn is not None
    np.testing.assert_allclose(drawn, harness.own.body.pose)


def test_it_stops_by_itself_when_the_session_hangs(harness: OwnRobotSession) -> None:
    harness.driver.twist = AHEAD
    harness.wait(10)
    harness.own.pass_time(0.4)
    stood = harness.own.body.pose.copy()
    harness.own.pass_time(2.0)
    np.testing.assert_array_equal(harness.own.body.pose, stood)
    assert harness.own.lease.expiries == 1


def test_its_map_grows_is_built_anew_and_leads_to_a_node(harness: OwnRobotSession) -> None:
    explore(harness)
    assert len(harness.now.moment.graph.ids) > 3
    harness.do(c.Ask(c.Action.BUILD))
    until(lambda: harness.wait().mode is Mode.TELEOP)
    goal = far_node(harness)
    place = harness.state.live_map.keyframes.observation(goal).odometry
    harness.do(c.Ask(c.Action.GOAL, goal))
    now = harness.until(lambda now: now.mode is Mode.TELEOP)
    assert now.moment.progress.ended is not None
    assert now.moment.progress.ended.outcome is Outcome.ARRIVED
    assert np.hypot(*(harness.own.body.pose - place)[:2]) < 0.72


def test_nobody_judges_an_arrival_where_nobody_knows_the_truth(harness: OwnRobotSession) -> None:
    explore(harness)
    harness.do(c.Ask(c.Action.GOAL, far_node(harness)))
    harness.until(lambda now: now.mode is Mode.TELEOP)
    assert not [row for row in harness.state.live.timeline.events if isinstance(row.event, Judged)]


def test_a_recording_holds_every_image_that_its_events_name_although_thinking_takes_time(tmp_path: Path) -> None:
    harness = OwnRobotSession(tmp_path, thought_s=0.12)
    harness.wait()
    explore(harness)
    harness.do(c.Ask(c.Action.RECORD))
    harness.do(c.Ask(c.Action.GOAL, far_node(harness)))
    harness.until(lambda now: now.mode is Mode.TELEOP)
    harness.do(c.Ask(c.Action.KEEP))
    (writer,) = harness.writers
    named = {row.event.frame for row in writer.events if isinstance(row.event, Localised)}
    assert named
    assert named <= {seen.step for seen in writer.frames}
    stamps = [seen.stamp for seen in writer.frames]
    assert stamps == sorted(stamps)


def test_it_stands_while_a_task_is_paused_and_drives_on_afterwards(harness: OwnRobotSession) -> None:
    explore(harness)
    harness.do(c.Ask(c.Action.GOAL, far_node(harness)))
    harness.until(lambda now: bool(harness.own.lease.command().linear_m_s))
    harness.do(c.Ask(c.Action.PAUSE))
    harness.wait(4)
    stood = harness.own.body.pose.copy()
    harness.wait(30)
    np.testing.assert_array_equal(harness.own.body.pose, stood)
    harness.do(c.Ask(c.Action.PAUSE))
    now = harness.until(lambda now: now.mode is Mode.TELEOP)
    assert now.moment.progress.ended is not None
    assert now.moment.progress.ended.outcome is Outcome.ARRIVED


def test_the_last_command_is_renewed_while_a_robot_drives_and_held_while_its_navigator_thinks() -> None:
    own = OwnRobot()
    robot = LiveRobot(own)
    robot.drive(AHEAD)
    own.pass_time(0.2)
    robot.renew()
    own.pass_time(0.2)
    assert own.lease.command() == AHEAD
    robot.hold()
    assert own.lease.command() == Twist(0.0, 0.0)
    robot.renew()
    assert own.lease.command() == AHEAD
    robot.stop()
    robot.renew()
    assert own.lease.command() == Twist(0.0, 0.0)


def test_its_images_are_numbered_after_those_of_the_map_that_was_there() -> None:
    own = OwnRobot()
    robot = LiveRobot(own, last_step=499, last_stamp_s=59.9)
    own.pass_time(1.0)
    seen = robot.observe()
    assert (seen.step, seen.stamp) == (510, pytest.approx(61.0))
    assert (robot.state().step, robot.state().stamp) == (510, pytest.approx(61.0))
    assert robot.clock.now() == pytest.approx(61.0)
    assert list(robot.taken()) == [seen]


def notes(harness: OwnRobotSession) -> list[str]:
    events = (stamped.event for stamped in harness.state.live.timeline.events)
    return [event.text for event in events if isinstance(event, Note)]


def test_a_camera_that_stands_still_is_told_once(harness: OwnRobotSession) -> None:
    harness.drive(AHEAD, 4)  # The images of this room are all black.
    assert len([text for text in notes(harness) if "is it covered?" in text]) == 1


def test_images_without_depth_are_told_once_and_stay_out_of_the_map(
    harness: OwnRobotSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(harness.state.live_map.predictor, "needs_depth", True, raising=False)
    seen = harness.own.observe
    monkeypatch.setattr(harness.own, "observe", lambda: replace(seen(), depth=np.zeros((72, 96), np.float32)))
    harness.drive(AHEAD, 2)
    assert len([text for text in notes(harness) if "has no depth" in text]) == 1
    assert set(harness.now.moment.graph.ids) <= {0}, "only the image from before may be a node"


def test_stamps_in_nanoseconds_are_said_and_end_nothing(
    harness: OwnRobotSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = harness.own.observe
    with monkeypatch.context() as wrong:
        wrong.setattr(harness.own, "observe", lambda: replace(seen(), stamp=1.7e18))
        harness.drive(AHEAD, 1)
        assert "divide nanoseconds" in said(harness.now)
    frames = harness.now.moment.frames
    harness.drive(AHEAD, 1)
    assert harness.now.moment.frames > frames


def test_of_a_recorded_drive_the_page_says_that_nothing_can_be_driven(harness: OwnRobotSession) -> None:
    harness.state.open_loop = "bag.mcap is a recorded drive."
    harness.drive(AHEAD, 0.2)
    assert harness.now.message is not None
    assert harness.now.message.text == harness.state.open_loop
    assert "A recorded drive replaces the robot" in hint(harness.now)
    harness.state.say("something else")
    harness.do(c.Ask(c.Action.GOAL, int(harness.now.moment.graph.ids[0])))
    assert harness.now.message.text == harness.state.open_loop
    assert harness.now.mode is Mode.TELEOP


def test_a_recorded_drive_begins_when_somebody_looks_and_can_be_played_again(tmp_path: Path) -> None:
    robot = OwnRobot()
    drive = play_drive(NamedDrive(straight_drive(tmp_path / "drive", frames=6)), robot.clock)
    drive.wait()
    harness = SessionHarness(
        tmp_path, mapped=False, own_robot=drive, predictor=SlowPredictor(robot, 0.0), executor=InlineExecutor()
    )
    harness.state.played = drive
    eyes: list[str] = []
    session = Session(harness.state, harness.driver, harness.shown.append, is_seen=lambda: bool(eyes))

    def wait(seconds: float) -> Snapshot:
        for _ in range(round(seconds / TICK_S)):
            robot.pass_time(TICK_S)
            session.tick()
        return harness.now

    session.tick()
    assert drive.is_waiting
    before = wait(3.0).moment.frames
    eyes.append("a page")
    shown = wait(3.0)
    assert shown.moment.frames > before
    assert "is over" in hint(shown)
    assert health_of(shown)[0] is Health.GOOD
    session.send(c.Ask(c.Action.PLAY_DRIVE))
    assert wait(3.0).moment.frames > shown.moment.frames
