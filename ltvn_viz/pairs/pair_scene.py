"""A pair seen from above: both cameras on the floor, and what each of them sees in a colour of its own.

Owns the scene nodes, in the source's frame: the source looks up the screen. So the same kind of pair always looks the
same, wherever in the apartment it is.
"""

import numpy as np
import viser
import viser.transforms as vt

from ltvn_core import palette
from ltvn_core.palette import Rgb8
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training_data.camera_projection import unproject
from ltvn_core.types import Depth, Waypoint
from ltvn_viz.layers.line_segments import LineSegments
from ltvn_viz.layers.pose_geometry import marker_mesh, points, wxyz
from ltvn_viz.pairs.pair_browser import ShownPair

CUT_M = 1.9
"""Points above this would hide the floor from above."""
POINT_STEP = 3
"""Every third point shows as much, and a page without a GPU keeps up."""
_RULED_M = 6
_CAMERA = LOCOBOT.camera
_CAMERA_TO_ROBOT = vt.SO3.from_matrix(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
"""From the camera's axes (right, down, ahead) to the robot's (ahead, left, up)."""


class PairScene:
    """Source, target and prediction in 3D."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add all nodes, hidden, and look straight down."""
        scene = server.scene
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map("warehouse", environment_intensity=0.35)
        server.initial_camera.look_at = (1.35, 0.0, 0.0)
        server.initial_camera.position = (0.75, 0.0, 5.2)
        # Plain squares of a metre: the grid of the library shades every pixel, which is slow without a GPU.
        _ruled(scene)
        self._source = _Camera(scene, "/source", palette.SOURCE)
        self._target = _Camera(scene, "/target", palette.TARGET)
        self._predicted = _arrow(scene, "/predicted", palette.PREDICTED_POSE, length_m=0.17, height_m=0.72)

    def show(self, shown_pair: ShownPair) -> None:
        """Place everything."""
        pair = shown_pair.pair
        self._predicted.visible = pair is not None
        if pair is None:
            self._source.hide()
            self._target.hide()
            return
        self._source.place(np.zeros(3), pair.source_depth)
        self._target.place(pair.waypoint, pair.target_depth)
        self._predicted.position = points(shown_pair.waypoint, 0.0)
        self._predicted.wxyz = wxyz(shown_pair.waypoint[2])


class _Camera:
    """An arrow where the robot stands, the frustum of its camera, and the points it sees."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb8) -> None:
        self._arrow = _arrow(scene, name, colour, length_m=0.3, height_m=0.66)
        fov = _CAMERA.vertical_fov_rad
        scene.add_camera_frustum(
            f"{name}/camera",
            float(fov),
            _CAMERA.width / _CAMERA.height,
            scale=0.5,
            thickness=0.02,
            color=colour,
            wxyz=_CAMERA_TO_ROBOT.wxyz,
            position=(0.0, 0.0, _CAMERA.height_m),
            cast_shadow=False,
            receive_shadow=False,
        )
        self._points = scene.add_point_cloud(
            f"{name}/points", np.zeros((1, 3)), colour, point_size=0.022, point_shape="square", point_shading="flat"
        )

    def hide(self) -> None:
        self._arrow.visible = False

    def place(self, pose: Waypoint, depth: Depth) -> None:
        self._arrow.visible = True
        self._arrow.position = points(pose, 0.0)
        self._arrow.wxyz = wxyz(pose[2])
        seen = unproject(depth)[::POINT_STEP]
        self._points.points = seen[seen[:, 2] < CUT_M]


def _ruled(scene: viser.SceneApi) -> None:
    marks = np.arange(-_RULED_M, _RULED_M + 1)
    low, high = np.full_like(marks, -_RULED_M), np.full_like(marks, _RULED_M)
    along = np.stack([np.column_stack([marks, low]), np.column_stack([marks, high])], axis=1)
    segments = points(np.concatenate([along, along[..., ::-1]]), 0.0)
    LineSegments(scene, "/floor", thickness_px=1.0).draw(segments, np.full((len(segments), 3), (52, 57, 69), np.uint8))


def _arrow(scene: viser.SceneApi, name: str, colour: Rgb8, *, length_m: float, height_m: float) -> viser.FrameHandle:
    frame = scene.add_frame(name, show_axes=False, visible=False)
    vertices, faces = marker_mesh(length_m, 0.02)
    scene.add_mesh_simple(
        f"{name}/arrow",
        vertices,
        faces,
        color=colour,
        position=(0.0, 0.0, height_m),
        cast_shadow=False,
        receive_shadow=False,
    )
    return frame
