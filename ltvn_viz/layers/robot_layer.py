"""The robot and the pyramid of what its camera sees."""

import viser

from ltvn_core import palette
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_viz.layers.pose_geometry import marker_mesh, points, wxyz
from ltvn_viz.session.snapshot import Snapshot

FORWARD_CAMERA_WXYZ = (0.5, -0.5, 0.5, -0.5)
"""Turns a camera that looks along z, with y down, into one that looks along the robot's x."""


class RobotLayer:
    """The robot where it really is, or where its odometry says where nobody knows better."""

    def __init__(self, scene: viser.SceneApi, spec: RobotSpec, glb: bytes | None) -> None:
        """Add the robot's body and camera, hidden until there is a pose.

        The body is `glb` (x forward, z up); without one, a plain cylinder of the size in `spec`.
        """
        self._body = scene.add_frame("/robot", show_axes=False, visible=False)
        if glb is None:
            _add_plain_body(scene, spec)
        else:
            scene.add_glb("/robot/body", glb, cast_shadow=False, receive_shadow=False)
        lens = spec.camera
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


def _add_plain_body(scene: viser.SceneApi, spec: RobotSpec) -> None:
    scene.add_cylinder(
        "/robot/body",
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
        "/robot/arrow",
        vertices,
        faces,
        color=palette.ACCENT,
        position=(0.0, 0.0, spec.height_m + 0.01),
        cast_shadow=False,
        receive_shadow=False,
    )
