"""A robot whose images are changed on their way to whoever looks; everything else is passed on."""

from abc import ABC, abstractmethod

from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


class RobotView(ABC):
    """Base of robots that are seen through something. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(self, robot: Robot) -> None:
        """Pass everything on to `robot` but its images."""
        self._robot = robot
        self._taken: Observation | None = None
        self._shown: Observation | None = None

    @abstractmethod
    def _changed(self, taken: Observation) -> Observation:
        """Return what is shown of an image; called once an image, while `_shown` is still the one before."""

    @property
    def spec(self) -> RobotSpec:
        """The robot's."""
        return self._robot.spec

    @property
    def clock(self) -> Clock:
        """The robot's."""
        return self._robot.clock

    def observe(self) -> Observation:
        """Take an image and change it; one that the robot returns twice is the very same both times."""
        taken = self._robot.observe()
        if self._shown is None or taken is not self._taken:
            self._taken = taken
            self._shown = self._changed(taken)
        return self._shown

    def state(self) -> RobotState:
        """Return the robot's odometry, clock and bumper."""
        return self._robot.state()

    def drive(self, twist: Twist) -> None:
        """Pass the command on."""
        self._robot.drive(twist)

    def stop(self) -> None:
        """Stop the robot."""
        self._robot.stop()
