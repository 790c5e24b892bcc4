"""The robot, the pyramid of its camera's field of view, and a line along the driven path."""

import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_viz.layers import TRAJECTORY_Z
from ltvn_viz.layers.shapes import LineSegments, marker_mesh, points, wxyz
from ltvn_viz.session.snapshot import Snapshot

FORWARD_CAMERA_WXYZ = (0.5, -0.5, 0.5, -0.5)
"""Rotation from a camera that looks along z, with y down, to one that looks along the robot's x."""
MAST_X_M = 0.06
"""Distance of the camera in front of the robot's centre, in metres."""


class RobotLayer:
    """The robot at its true pose, or at its odometry pose if the true one is unknown."""

    def __init__(self, scene: viser.SceneApi, spec: RobotSpec, glb: bytes | None) -> None:
        """Add the robot's body and camera, hidden until there is a pose.

        The body is `glb` (x forward, z up); without one, a plain cylinder of the size in `spec`.
        """
        self._place = scene.add_frame("/robot", show_axes=False, visible=False)
        self._body = scene.add_frame("/robot/body", show_axes=False)
        if glb is None:
            _add_plain_body(scene, spec)
        else:
            scene.add_glb("/robot/body/model", glb, cast_shadow=False, receive_shadow=False)
        self._own_camera = self._drawn_camera = spec.camera
        self._view = scene.add_camera_frustum(
            "/robot/view",
            fov=float(spec.camera.vertical_fov_rad),
            aspect=spec.camera.width / spec.camera.height,
            scale=0.25,
            thickness=1.5,
            thickness_units="screen",
            color=palette.ACCENT,
            wxyz=FORWARD_CAMERA_WXYZ,
            position=(MAST_X_M, 0.0, spec.camera.height_m),
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, snapshot: Snapshot) -> None:
        """Move the robot to its pose; for an unknown robot, draw the camera alone."""
        pose = snapshot.moment.robot
        lone = snapshot.lone_camera
        self._show_camera(self._own_camera if lone is None else lone, is_alone=lone is not None)
        if pose is not None:
            self._place.position = points(pose, 0.0)
            self._place.wxyz = wxyz(pose[2])
        self._place.visible = pose is not None

    def _show_camera(self, camera: CameraModel, *, is_alone: bool) -> None:
        if camera is self._drawn_camera:
            return
        self._drawn_camera = camera
        self._body.visible = not is_alone
        self._view.fov = float(camera.vertical_fov_rad)
        self._view.aspect = camera.width / camera.height
        self._view.position = (0.0 if is_alone else MAST_X_M, 0.0, camera.height_m)


def _add_plain_body(scene: viser.SceneApi, spec: RobotSpec) -> None:
    scene.add_cylinder(
        "/robot/body/cylinder",
        radius=spec.radius_m,
        height=spec.height_m,
        color=palette.NODE,
        opacity=0.55,
        position=(0.0, 0.0, spec.height_m / 2),
        cast_shadow=False,
        receive_shadow=False,
    )
    vertices, faces = marker_mesh(2 * spec.radius_m, 0.02)
    scene.add_mesh_simple(
        "/robot/body/arrow",
        vertices,
        faces,
        color=palette.ACCENT,
        position=(0.0, 0.0, spec.height_m + 0.01),
        cast_shadow=False,
        receive_shadow=False,
    )


REDRAW_EVERY_S = 0.4
JUMP_M = 1.5
"""Least distance between two poses, in metres, that counts as a jump: the robot was put elsewhere and did not drive."""


class TrajectoryLayer:
    """One line along all poses of the run."""

    def __init__(self, scene: viser.SceneApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the empty line."""
        self.lines = LineSegments(scene, "/trajectory", thickness_px=3.0)
        self._clock = clock
        self._drawn: NDArray[np.float64] | None = None
        self._when = -np.inf

    def show(self, snapshot: Snapshot) -> None:
        """Draw the trajectory when it changed, a few times a second at most."""
        poses = snapshot.moment.trajectory
        if poses is self._drawn or self._clock() - self._when < REDRAW_EVERY_S:
            return
        self._drawn = poses
        self._when = self._clock()
        self.lines.draw_path(poses, TRAJECTORY_Z, palette.TRAJECTORY, jump_m=JUMP_M)
