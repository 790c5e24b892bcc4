"""The live run: the robot, its timeline and its recording, kept in step.

Owns the rule that every image and event goes to timeline and recording together. Decides nothing.
"""

from typing import Protocol

from ltvn_core.nav.events import Event, Stamped
from ltvn_core.types import FrameId, Observation, Pose, Robot
from ltvn_viz.recorder import Recorder
from ltvn_viz.timeline import Timeline
from ltvn_viz.why.watch import Watch
from ltvn_viz.worker import Worker

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


class Live:
    """What is going on now."""

    def __init__(self, robot: LiveRobot, recorder: Recorder, timeline: Timeline) -> None:
        """Watch `robot`."""
        self.robot, self.recorder, self.timeline = robot, recorder, timeline
        self.watch = Watch()
        """What a person wants to stop at."""
        self.seen: Observation | None = None
        """The newest image."""

    def capture(self) -> Observation:
        """Take a picture for the timeline and the recording, at most one per control step."""
        seen = self.robot.observe()
        if self.seen is None or seen.step != self.seen.step:
            self.seen = seen
            self.timeline.frame(seen.step, seen.stamp, seen.odometry if seen.exact_pose is None else seen.exact_pose)
            self.recorder.frame(seen)
        return seen

    def begin_recording(self, worker: Worker) -> None:
        """Begin a recording with a picture of now; raises RecordingError. Nobody else may use the robot meanwhile."""
        self.recorder.start(worker)
        before = self.seen
        if self.capture() is before and before is not None:
            self.recorder.frame(before)

    def emit(self, event: Event) -> None:
        """Let an event have happened now."""
        stamped = Stamped(self.robot.step, self.robot.stamp, event)
        self.timeline.event(stamped)
        self.recorder.event(stamped)
        self.watch.take(stamped, self.timeline.start_s)
