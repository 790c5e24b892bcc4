"""A robot whose steps and stamps go on from those of a map, so that a frame's number is unique in a recording."""

from dataclasses import replace

from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import CONTROL_STEP_S, FrameId, Observation, RobotState


class ContinuedRobot(RobotView):
    """Adds to steps and stamps; a robot that counts on by itself stays as it is."""

    def __init__(self, robot: Robot, *, last_step: FrameId, last_stamp_s: float) -> None:
        """Go on after a map's last image."""
        super().__init__(robot)
        state = robot.state()
        self._steps = max(0, last_step + 1 - state.step)
        self._seconds = max(0.0, last_stamp_s + CONTROL_STEP_S - state.stamp)

    def state(self) -> RobotState:
        """Return the robot's, counted on."""
        state = self._robot.state()
        return state._replace(step=state.step + self._steps, stamp=state.stamp + self._seconds)

    def _changed(self, taken: Observation) -> Observation:
        return replace(taken, step=taken.step + self._steps, stamp=taken.stamp + self._seconds)
