"""The live run: keeps the robot, its timeline and its recording in step.

Images continue the numbering of the map that the app started with, and each is handed over once. The last command is
stored, so that the session can renew it while the robot moves and stop it while the navigator computes. Owns the rule
that every image and event goes to timeline and recording together. Makes no decisions, and is independent of the
simulator.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from queue import SimpleQueue

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording.recorded_run import ImageRecorder
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Event, GraphChanged, StampedEvent
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_view import ContinuedRobot
from ltvn_core.types import FrameId, Observation, Pose, Twist
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor


class LiveRobot(ContinuedRobot):
    """A robot that hands over each image once, and whose last command can be renewed."""

    def __init__(
        self,
        robot: Robot,
        *,
        last_step: FrameId = -1,
        last_stamp_s: float = -math.inf,
        ground_truth: Callable[[], Pose] | None = None,
    ) -> None:
        """Drive `robot`, whose steps and stamps continue those of a map, see `ContinuedRobot`.

        `ground_truth` returns its true pose (3,) in simulation.
        """
        super().__init__(robot, last_step=last_step, last_stamp_s=last_stamp_s)
        self._ground_truth = ground_truth
        self._command: Twist | None = None
        self._observation: Observation | None = None
        self._handed_over: FrameId | None = None
        self._queue: SimpleQueue[Observation] = SimpleQueue()

    @property
    def exact_pose(self) -> Pose | None:
        """True pose (3,), in simulation only; for drawing and for the verdict on a query."""
        return None if self._ground_truth is None else self._ground_truth()

    @property
    def drawn_pose(self) -> Pose:
        """Pose (3,) at which the page draws the robot: the true pose if it is known, else odometry."""
        exact = self.exact_pose
        return self._robot.state().odometry if exact is None else exact

    def observe(self) -> Observation:
        """Take an image that is also added to timeline and recording, at most one per control step."""
        seen = self.glance()
        if seen.step != self._handed_over:
            self._handed_over = seen.step
            self._queue.put(seen)
        return seen

    def glance(self) -> Observation:
        """Take an image only for display, or return the one already taken in this control step."""
        seen = super().observe()
        if self._observation is None or seen.step != self._observation.step:
            self._observation = seen
        return self._observation

    def taken(self) -> Iterator[Observation]:
        """Yield, once each, the images that `observe` took."""
        while not self._queue.empty():
            yield self._queue.get()

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the duration of a lease."""
        self._command = twist
        self._robot.drive(twist)

    def stop(self) -> None:
        """Stop now."""
        self._command = None
        self._robot.stop()

    def renew(self) -> None:
        """Renew the last velocity command for another lease, if the clock is real and the robot was not stopped."""
        if self._command is not None and not self._clock.is_simulated:
            self._robot.drive(self._command)

    def hold(self) -> None:
        """On a real clock, stand still until the next command or `renew`."""
        if not self._clock.is_simulated:
            self._robot.stop()


TICK_S = 1 / 30
"""Robot time between two updates of the page at real-time speed, in seconds."""


class LiveRun:
    """The live run."""

    def __init__(self, robot: LiveRobot, recorder: Recorder, timeline: Timeline) -> None:
        """Watch `robot`."""
        self.robot = robot
        self.recorder = recorder
        self.timeline = timeline
        self.breakpoint_monitor = BreakpointMonitor()
        """Breakpoints of the person."""
        self.pace = 1
        """Target speed of a simulator's time as a factor of real time."""
        self._images = ImageRecorder(self._write_frame, self._append)
        self.observation: Observation | None = None
        """The newest image in timeline and recording."""
        self.view: Observation | None = None
        """The newest image, including those only for display."""
        self._view_is_old = False

    @property
    def tick_s(self) -> float:
        """Robot time in seconds between two updates of the page, if a simulator computes it."""
        return TICK_S * self.pace

    @property
    def now_s(self) -> float:
        """Time in seconds on the robot's clock, or of the last event if that is later."""
        return max(self.robot.state().stamp, self.timeline.end_s)

    def let_pass(self, duration_s: float) -> None:
        """Advance robot time: a simulator computes it, while a wall clock runs by itself and is not waited for."""
        if self.robot.clock.is_simulated:
            self.robot.clock.advance(duration_s)

    def capture(self) -> Observation:
        """Take an image for the timeline and the recording, at most one per control step."""
        observation = self.robot.observe()
        self._take_in()
        return observation

    def glance(self) -> None:
        """Ask for a new image that is only for display; `renew_view` takes it when somebody looks."""
        self._view_is_old = True

    def renew_view(self) -> None:
        """Take the image that `glance` asked for, if it did since the last call. Raises RobotError."""
        if self._view_is_old:
            self._view_is_old = False
            self.view = self.robot.glance()

    def begin_recording(self) -> None:
        """Start a recording with the current image; raises OptionError if one is running.

        Nothing else may use the robot during the call.
        """
        self.recorder.start()
        before = self.observation
        if self.capture() is before and before is not None:
            self.recorder.write_frame(before)

    def emit(self, event: Event) -> None:
        """Add an event at the current time."""
        self._take_in()  # Events name images by their step, so the images come first.
        now = self.robot.state()
        self._append(StampedEvent(now.step, now.stamp, event))

    def emit_changes(self, deltas: Iterable[GraphDelta]) -> None:
        """Add changes of the map at the current time."""
        for delta in deltas:
            self.emit(GraphChanged(delta))

    def _append(self, stamped: StampedEvent) -> None:
        self.timeline.append_event(stamped)
        self.recorder.write_event(stamped)
        self.breakpoint_monitor.consume(self.timeline)

    def _take_in(self) -> None:
        """Add the images that session and navigator took to timeline and recording."""
        for observation in self.robot.taken():
            self._images.record(observation)

    def _write_frame(self, observation: Observation) -> None:
        self.observation = observation
        self.view = observation
        self._view_is_old = False
        self.timeline.append_frame(
            observation.step,
            observation.stamp,
            observation.odometry if observation.exact_pose is None else observation.exact_pose,
        )
        self.recorder.write_frame(observation)
