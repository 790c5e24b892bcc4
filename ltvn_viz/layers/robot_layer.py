"""The LoCoBot and the pyramid of what its camera sees."""

import viser

from ltvn_core import palette
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_viz.layers.pose_geometry import points, wxyz
from ltvn_viz.session.snapshot import Snapshot

FORWARD_CAMERA_WXYZ = (0.5, -0.5, 0.5, -0.5)
"""Turns a camera that looks along z, with y down, into one that looks along the robot's x."""


class RobotLayer:
    """The robot where it really is."""

    def __init__(self, scene: viser.SceneApi, glb: bytes) -> None:
        """Add the robot's body (GLB, x forward, z up) and camera, hidden until there is a pose."""
        self._body = scene.add_frame("/robot", show_axes=False, visible=False)
        scene.add_glb("/robot/body", glb, cast_shadow=False, receive_shadow=False)
        lens = LOCOBOT.camera
        fov = lens.vertical_fov_rad
        scene.add_camera_frustum(
            "/robot/view",
            fov=float(fov),
            aspect=lens.width / lens.height,
            scale=0.25,
            thickness=1.5,
            thickness_units="screen",
            color=palette.ACCENT,
            wxyz=FORWARD_CAMERA_WXYZ,
            position=(0.06, 0.0, lens.height_m),
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, snapshot: Snapshot) -> None:
        """Move the robot to its pose."""
        pose = snapshot.moment.robot
        if pose is not None:
            self._body.position = points(pose, 0.0)
            self._body.wxyz = wxyz(pose[2])
        self._body.visible = pose is not None
