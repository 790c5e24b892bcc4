"""The live run: the robot, its timeline and its recording, kept in step.

Owns the rule that every image and event goes to timeline and recording together. Decides nothing.
"""

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.recording.recorded_robot import ImageRecorder
from ltvn_core.types import Observation
from ltvn_viz.session.live_robot import LiveRobot
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor

TICK_S = 1 / 30
"""Robot time between two pictures of the page, where it goes as fast as that of the person who watches."""


class LiveRun:
    """What is going on now."""

    def __init__(self, robot: LiveRobot, recorder: Recorder, timeline: Timeline) -> None:
        """Watch `robot`."""
        self.robot, self.recorder, self.timeline = robot, recorder, timeline
        self.breakpoint_monitor = BreakpointMonitor()
        """What a person wants to stop at."""
        self.pace = 1
        """So many times as fast a simulator's time goes, as far as the computer can follow."""
        self._images = ImageRecorder(self._write_frame, self._append)
        self.observation: Observation | None = None
        """The newest image of timeline and recording."""
        self.view: Observation | None = None
        """The newest image of all."""

    @property
    def tick_s(self) -> float:
        """Robot time between two pictures of the page, where a simulator computes it."""
        return TICK_S * self.pace

    @property
    def now_s(self) -> float:
        """The robot's clock, or the last thing that happened where that is later; seconds."""
        return max(self.robot.state().stamp, self.timeline.end_s)

    def let_pass(self, duration_s: float) -> None:
        """Let robot time pass: a simulator computes it, the wall's passes by itself and is not waited for."""
        if self.robot.clock.is_simulated:
            self.robot.clock.advance(duration_s)

    def capture(self) -> Observation:
        """Take a picture for the timeline and the recording, at most one per control step."""
        observation = self.robot.observe()
        self._take_in()
        return observation

    def glance(self) -> None:
        """Take a picture to be shown, and for nothing else."""
        self.view = self.robot.glance()

    def begin_recording(self) -> None:
        """Begin a recording with a picture of now; raises RecordingError. Nobody else may use the robot meanwhile."""
        self.recorder.start()
        before = self.observation
        if self.capture() is before and before is not None:
            self.recorder.write_frame(before)

    def emit(self, event: Event) -> None:
        """Let an event have happened now."""
        self._take_in()  # Events name images by their step, so the images come first.
        now = self.robot.state()
        self._append(StampedEvent(now.step, now.stamp, event))

    def _append(self, stamped: StampedEvent) -> None:
        self.timeline.append_event(stamped)
        self.recorder.write_event(stamped)
        self.breakpoint_monitor.consume(self.timeline)

    def _take_in(self) -> None:
        """Put the images that session and navigator took into timeline and recording."""
        for observation in self.robot.taken():
            self._images.record(observation)

    def _write_frame(self, observation: Observation) -> None:
        self.observation = observation
        self.view = observation
        self.timeline.append_frame(
            observation.step,
            observation.stamp,
            observation.odometry if observation.exact_pose is None else observation.exact_pose,
        )
        self.recorder.write_frame(observation)
