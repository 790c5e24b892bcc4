"""The robot as the session drives it, whether its time is a simulator's or the wall's.

Numbers its images after those of the map that the app began with, hands every image to timeline and recording, and
remembers the last command, so that the session can renew it while the robot moves and hold it while the navigator
thinks. Knows no simulator.
"""

from collections.abc import Callable, Iterator
from queue import SimpleQueue

from ltvn_core.image_validity import check_observation
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import FrameId, Observation, Pose, RobotState, Twist


class LiveRobot:
    """Passes everything on to a robot. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(
        self,
        robot: Robot,
        *,
        first_step: FrameId = 0,
        first_stamp: float = 0.0,
        ground_truth: Callable[[], Pose] | None = None,
    ) -> None:
        """Drive `robot`, whose count of control steps and clock go on from `first_step` and `first_stamp` seconds.

        `ground_truth` returns its true pose (3,) where a simulator knows it.
        """
        self._robot = robot
        self._ground_truth = ground_truth
        self._added_steps = max(0, first_step - robot.state().step)
        self._added_s = max(0.0, first_stamp - robot.clock.now())
        self._clock = _ContinuedClock(robot.clock, self._added_s) if self._added_s else robot.clock
        self._command: Twist | None = None
        self._observation: Observation | None = None
        self._handed_over: FrameId | None = None
        self._taken: SimpleQueue[Observation] = SimpleQueue()

    @property
    def spec(self) -> RobotSpec:
        """The robot's."""
        return self._robot.spec

    @property
    def clock(self) -> Clock:
        """The robot's, going on from the map's time."""
        return self._clock

    @property
    def exact_pose(self) -> Pose | None:
        """Where it really is, (3,), in simulation only; for drawing and for the verdict on a query."""
        return None if self._ground_truth is None else self._ground_truth()

    @property
    def drawn_pose(self) -> Pose:
        """Where the page draws it, (3,): where it really is if anybody knows, else where odometry says."""
        exact = self.exact_pose
        return self._robot.state().odometry if exact is None else exact

    def state(self) -> RobotState:
        """Return odometry, clock and bumper."""
        state = self._robot.state()
        return state._replace(stamp=state.stamp + self._added_s, step=state.step + self._added_steps)

    def observe(self) -> Observation:
        """Take an image that timeline and recording get too, at most one per control step."""
        seen = self.glance()
        if seen.step != self._handed_over:
            self._handed_over = seen.step
            self._taken.put(seen)
        return seen

    def glance(self) -> Observation:
        """Take an image to look at alone, or return the one already taken in this control step."""
        taken = self._robot.observe()
        step = taken.step + self._added_steps
        if self._observation is None or step != self._observation.step:
            self._observation = self._checked(taken, step)
        return self._observation

    def _checked(self, taken: Observation, step: FrameId) -> Observation:
        """Return an image as it counts here. Raises ImageError where it, its place or its time cannot be."""
        return check_observation(
            taken.rgb,
            taken.depth,
            taken.odometry,
            stamp=taken.stamp + self._added_s,
            step=step,
            exact_pose=taken.exact_pose,
            original=taken.original,
            tilt=taken.tilt,
            source=self._robot.spec.name,
        )

    def taken(self) -> Iterator[Observation]:
        """Yield, once each, the images that `observe` took."""
        while not self._taken.empty():
            yield self._taken.get()

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


class _ContinuedClock:
    """A clock that shows more than another. Implements `ltvn_core.robots.robot.Clock`."""

    def __init__(self, clock: Clock, added_s: float) -> None:
        self._clock = clock
        self._added_s = added_s

    @property
    def is_simulated(self) -> bool:
        return self._clock.is_simulated

    def now(self) -> float:
        return self._clock.now() + self._added_s

    def advance(self, duration_s: float) -> None:
        self._clock.advance(duration_s)
