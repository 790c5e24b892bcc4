"""Wrappers that change the images of a robot and pass everything else on.

Session, command line and navigator use any robot through `fit_camera(robot, predictor.camera)`. Owns the rectification
of images, the storage of the originals, and steps and stamps that continue those of a map.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.original_images import OriginalSize
from ltvn_core.cameras.rectification import have_same_rays, rectified_camera
from ltvn_core.geometry import relative
from ltvn_core.preprocessing import ORIGINAL_SIZE, admit_observation, continued_observation
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import CONTROL_STEP_S, FrameId, Observation, Pose, RobotState, Twist


class RobotView(ABC):
    """Base class of wrapped robots. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(self, robot: Robot) -> None:
        """Wrap `robot`; only its images are changed."""
        self._robot = robot
        self._taken: Observation | None = None
        self._shown: Observation | None = None

    @abstractmethod
    def _changed(self, taken: Observation) -> Observation:
        """Return the changed image; called once per image, while `_shown` is still the previous one."""

    @property
    def spec(self) -> RobotSpec:
        """The robot's properties."""
        return self._robot.spec

    @property
    def clock(self) -> Clock:
        """The robot's clock."""
        return self._robot.clock

    def observe(self) -> Observation:
        """Take an image and change it; if the robot returns the same image again, the result is also the same
        object."""
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


class ContinuedRobot(RobotView):
    """Adds an offset to steps and stamps, and checks each image; no offset if the robot already continues them."""

    def __init__(self, robot: Robot, *, last_step: FrameId = -1, last_stamp_s: float = -math.inf) -> None:
        """Continue after the last image of a map; by default steps and stamps are the robot's own."""
        super().__init__(robot)
        state = robot.state()
        self._steps = max(0, last_step + 1 - state.step)
        self._seconds = max(0.0, last_stamp_s + CONTROL_STEP_S - state.stamp)
        self._clock = _ContinuedClock(robot.clock, self._seconds) if self._seconds else robot.clock

    @property
    def clock(self) -> Clock:
        """The robot's clock, with the offset."""
        return self._clock

    def state(self) -> RobotState:
        """Return the robot's state, with the offsets."""
        state = self._robot.state()
        return state._replace(step=state.step + self._steps, stamp=state.stamp + self._seconds)

    def _changed(self, taken: Observation) -> Observation:
        """Return an image with the offsets. Raises ImageError if the image, its pose or its time is invalid."""
        source = self._robot.spec.name
        return continued_observation(taken, steps=self._steps, seconds=self._seconds, source=source)


class _ContinuedClock:
    """A clock with an offset to another. Implements `ltvn_core.robots.robot.Clock`."""

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


def fit_camera(robot: Robot, target: CameraModel, *, original_size: OriginalSize | None = ORIGINAL_SIZE) -> Robot:
    """Return a robot whose images are those of the camera `target`; the same robot if its camera already fits.

    The `spec.camera` of the result is `target` at the height of the robot's own camera. Recordings keep the original
    images in at most `original_size`; None keeps none.
    """
    camera = robot.spec.camera
    if have_same_rays(camera, target) and camera.depth_scale == 1.0:
        return robot
    return RectifiedRobot(robot, target, original_size)


class RectifiedRobot(RobotView):
    """Rectifies the images of a robot, each once."""

    def __init__(self, robot: Robot, target: CameraModel, original_size: OriginalSize | None) -> None:
        """Rectify images to the camera `target`; see `fit_camera`."""
        super().__init__(robot)
        self._target = target
        self._original_size = original_size
        self._spec = replace(robot.spec, camera=rectified_camera(robot.spec.camera, target))

    @property
    def spec(self) -> RobotSpec:
        """The robot's properties, with the camera of the rectified images."""
        return self._spec

    def _changed(self, taken: Observation) -> Observation:
        camera = self._robot.spec.camera
        return admit_observation(taken, camera, self._target, original_size=self._original_size, source=self._spec.name)


IMAGE_EVERY_M = 0.12
"""Distance after which an image is taken on a mapping drive, in metres (ours)."""
IMAGE_EVERY_RAD = math.radians(10)
"""Change of heading after which an image is taken on a mapping drive, in radians (ours)."""


def watch_drive(robot: Robot, is_over: Callable[[], bool]) -> Iterator[Observation]:
    """Yield the first image, and one after every 12 cm or 10 degrees by odometry, until `is_over` returns True."""
    last: Observation | None = None
    while not is_over():
        seen = robot.observe()
        if last is None or has_moved(last.odometry, seen.odometry, by_m=IMAGE_EVERY_M, by_rad=IMAGE_EVERY_RAD):
            last = seen
            yield seen
        robot.clock.advance(CONTROL_STEP_S)


def has_moved(before: Pose, now: Pose, *, by_m: float, by_rad: float) -> bool:
    """Tell whether two poses (3,) differ by at least a distance or a turn."""
    ahead, aside, turned = relative(before, now)
    return bool(np.hypot(ahead, aside) >= by_m or abs(turned) >= by_rad)
