"""The live run: the robot, its timeline and its recording, kept in step.

Owns the rule that every image and event goes to timeline and recording together. Decides nothing.
"""

from typing import Protocol

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.robots.robot import Robot
from ltvn_core.types import FrameId, Observation, Pose
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.session.worker import Worker
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor

TICK_S = 1 / 30
"""Robot time between two pictures of the page."""


class LiveRobot(Robot, Protocol):
    """A robot whose time the session moves."""

    @property
    def exact_pose(self) -> Pose:
        """Where it really is, (3,), for drawing."""
        ...

    @property
    def step(self) -> FrameId:
        """Count of control steps."""
        ...

    @property
    def stamp(self) -> float:
        """Seconds on the robot's clock."""
        ...

    def advance(self, duration_s: float) -> None:
        """Let robot time pass."""
        ...


class LiveRun:
    """What is going on now."""

    def __init__(self, robot: LiveRobot, recorder: Recorder, timeline: Timeline) -> None:
        """Watch `robot`."""
        self.robot, self.recorder, self.timeline = robot, recorder, timeline
        self.breakpoint_monitor = BreakpointMonitor()
        """What a person wants to stop at."""
        self.observation: Observation | None = None
        """The newest image."""

    def capture(self) -> Observation:
        """Take a picture for the timeline and the recording, at most one per control step."""
        observation = self.robot.observe()
        if self.observation is None or observation.step != self.observation.step:
            self.observation = observation
            self.timeline.append_frame(
                observation.step,
                observation.stamp,
                observation.odometry if observation.exact_pose is None else observation.exact_pose,
            )
            self.recorder.write_frame(observation)
        return observation

    def begin_recording(self, worker: Worker) -> None:
        """Begin a recording with a picture of now; raises RecordingError. Nobody else may use the robot meanwhile."""
        self.recorder.start(worker)
        before = self.observation
        if self.capture() is before and before is not None:
            self.recorder.write_frame(before)

    def emit(self, event: Event) -> None:
        """Let an event have happened now."""
        stamped = StampedEvent(self.robot.step, self.robot.stamp, event)
        self.timeline.append_event(stamped)
        self.recorder.write_event(stamped)
        self.breakpoint_monitor.consume(self.timeline)
