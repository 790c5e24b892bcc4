"""A robot seen through the camera that a predictor asks for.

Session, command line and navigator look at any robot through `fit_camera(robot, predictor.camera)`. Owns the rectifying
of its images and the keeping of the originals; everything else is passed on.
"""

from dataclasses import replace

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.original_images import OriginalSize
from ltvn_core.cameras.rectification import have_same_rays, rectified_camera
from ltvn_core.preprocessing import ORIGINAL_SIZE, admit_observation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import Observation


def fit_camera(robot: Robot, target: CameraModel, *, original_size: OriginalSize | None = ORIGINAL_SIZE) -> Robot:
    """Return the robot with images as `target` would take them; the very same robot where its camera does already.

    The result's `spec.camera` is `target` at the height of the robot's own camera. Recordings of it keep the original
    images at most at `original_size`; None keeps none.
    """
    camera = robot.spec.camera
    if have_same_rays(camera, target) and camera.depth_scale == 1.0:
        return robot
    return RectifiedRobot(robot, target, original_size)


class RectifiedRobot(RobotView):
    """Rectifies what a robot sees, each image once."""

    def __init__(self, robot: Robot, target: CameraModel, original_size: OriginalSize | None) -> None:
        """Look through the camera `target`; see `fit_camera`."""
        super().__init__(robot)
        self._target = target
        self._original_size = original_size
        self._spec = replace(robot.spec, camera=rectified_camera(robot.spec.camera, target))

    @property
    def spec(self) -> RobotSpec:
        """The robot's, with the camera of the rectified images."""
        return self._spec

    def _changed(self, taken: Observation) -> Observation:
        camera = self._robot.spec.camera
        return admit_observation(taken, camera, self._target, original_size=self._original_size, source=self._spec.name)
