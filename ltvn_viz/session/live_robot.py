"""The robot as the session drives it, whether its time is a simulator's or the wall's.

Numbers its images after those of the map that the app began with, hands every image to timeline and recording, and
remembers the last command, so that the session can renew it while the robot moves and hold it while the navigator
thinks. Knows no simulator.
"""

import math
from collections.abc import Callable, Iterator
from queue import SimpleQueue

from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_view import ContinuedRobot
from ltvn_core.types import FrameId, Observation, Pose, Twist


class LiveRobot(ContinuedRobot):
    """A robot whose images are handed over once each and whose last command can be renewed."""

    def __init__(
        self,
        robot: Robot,
        *,
        last_step: FrameId = -1,
        last_stamp_s: float = -math.inf,
        ground_truth: Callable[[], Pose] | None = None,
    ) -> None:
        """Drive `robot`, whose steps and stamps go on after a map's last image, see `ContinuedRobot`.

        `ground_truth` returns its true pose (3,) where a simulator knows it.
        """
        super().__init__(robot, last_step=last_step, last_stamp_s=last_stamp_s)
        self._ground_truth = ground_truth
        self._command: Twist | None = None
        self._observation: Observation | None = None
        self._handed_over: FrameId | None = None
        self._queue: SimpleQueue[Observation] = SimpleQueue()

    @property
    def exact_pose(self) -> Pose | None:
        """Where it really is, (3,), in simulation only; for drawing and for the verdict on a query."""
        return None if self._ground_truth is None else self._ground_truth()

    @property
    def drawn_pose(self) -> Pose:
        """Where the page draws it, (3,): where it really is if anybody knows, else where odometry says."""
        exact = self.exact_pose
        return self._robot.state().odometry if exact is None else exact

    def observe(self) -> Observation:
        """Take an image that timeline and recording get too, at most one per control step."""
        seen = self.glance()
        if seen.step != self._handed_over:
            self._handed_over = seen.step
            self._queue.put(seen)
        return seen

    def glance(self) -> Observation:
        """Take an image to look at alone, or return the one already taken in this control step."""
        seen = super().observe()
        if self._observation is None or seen.step != self._observation.step:
            self._observation = seen
        return self._observation

    def taken(self) -> Iterator[Observation]:
        """Yield, once each, the images that `observe` took."""
        while not self._queue.empty():
            yield self._queue.get()

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the time of a lease."""
        self._command = twist
        self._robot.drive(twist)

    def stop(self) -> None:
        """Stop now."""
        self._command = None
        self._robot.stop()

    def renew(self) -> None:
        """Command the last velocity for another lease, where time passes by itself and nobody stopped the robot."""
        if self._command is not None and not self._clock.is_simulated:
            self._robot.drive(self._command)

    def hold(self) -> None:
        """Stand still until the next command or `renew`, where time passes by itself."""
        if not self._clock.is_simulated:
            self._robot.stop()
