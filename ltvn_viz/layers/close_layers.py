"""The robot's marker, whose size depends on the camera of each page.

The marker is visible at every zoom: it is above all walls, at least half a metre large, and grows with the distance of
the camera, so that its size on the screen stays about the same.
"""

from functools import partial

import numpy as np
import viser

from ltvn_core import palette
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M
from ltvn_viz.layers.shapes import Mesh, disc_mesh, marker_mesh, points, wxyz
from ltvn_viz.session.snapshot import Snapshot

MARKER_Z = CUT_HEIGHT_M + 0.25
"""Height of the marker in metres: above the walls, which are cut, and above the handles of doors."""
LEAST_MARKER_M = 0.5
MARKER_PER_DISTANCE = 0.045
"""Size of the marker per distance of the camera, both in metres."""
_RESIZE_FROM = 1.1
"""Least factor by which the size must change before it is sent to the page."""
_STEM_M = 0.03


class RobotMarker:
    """A bright arrow in a bright ring above the robot, with a stem that ends at the robot's position."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Add the marker, hidden until there is a pose."""
        self._camera = client.camera
        scene = client.scene
        self.place = scene.add_frame("/marker", show_axes=False, visible=False)
        flat = partial(_flat_mesh, scene)
        self.arrow = flat("/marker/arrow", marker_mesh(0.62, 0.02), palette.ROBOT, MARKER_Z + 0.06)
        ground = flat("/marker/ground", disc_mesh(0.6, 20), palette.BACKGROUND, MARKER_Z + 0.03)
        halo = flat("/marker/halo", disc_mesh(0.7, 20), palette.ROBOT, MARKER_Z)
        self._parts = (self.arrow, ground, halo)
        scene.add_box(
            "/marker/stem",
            color=palette.ROBOT,
            dimensions=(_STEM_M, _STEM_M, MARKER_Z),
            position=(0.0, 0.0, MARKER_Z / 2),
            cast_shadow=False,
            receive_shadow=False,
        )
        self.size_m = 0.0
        """Approximate radius of the marker in metres."""

    def show(self, snapshot: Snapshot) -> None:
        """Move the marker to the robot, and adapt its size to the camera's distance."""
        pose = snapshot.moment.robot
        if pose is not None:
            self.place.position = points(pose, 0.0)
            self.place.wxyz = wxyz(pose[2])
            self._resize(float(np.linalg.norm(self._camera.position - np.array([*pose[:2], MARKER_Z]))))
        self.place.visible = pose is not None

    def _resize(self, distance_m: float) -> None:
        wanted = max(LEAST_MARKER_M, MARKER_PER_DISTANCE * distance_m)
        if self.size_m and 1 / _RESIZE_FROM < wanted / self.size_m < _RESIZE_FROM:
            return
        self.size_m = wanted
        for part in self._parts:
            part.scale = wanted


def _flat_mesh(
    scene: viser.SceneApi,
    name: str,
    mesh: Mesh,
    colour: palette.Rgb8,
    height_m: float,
) -> viser.MeshHandle:
    return scene.add_mesh_simple(
        name,
        *mesh,
        color=colour,
        position=(0.0, 0.0, height_m),
        side="double",
        cast_shadow=False,
        receive_shadow=False,
    )
