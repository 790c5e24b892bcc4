"""One fixed scene node of many flat drops that point where a place looks, and that change in place."""

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.types import Pose
from ltvn_viz.layers.pose_geometry import marker_mesh, points, wxyz


class PoseMarkers:
    """A batch of drops."""

    def __init__(self, scene: viser.SceneApi, name: str, length_m: float) -> None:
        """Add the node, empty and hidden."""
        vertices, faces = marker_mesh(length_m, 0.03)
        self.handle = scene.add_batched_meshes_simple(
            name,
            vertices,
            faces,
            batched_wxyzs=np.array([[1.0, 0.0, 0.0, 0.0]]),
            batched_positions=np.zeros((1, 3)),
            batched_colors=palette.srgb_to_linear(np.array([palette.NODE])),
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def place(self, poses: Pose, height_m: float) -> None:
        """Put the drops at poses (N, 3), as many as there are; none hides the node."""
        if len(poses):
            self.handle.batched_positions = points(poses, height_m)
            self.handle.batched_wxyzs = wxyz(poses[:, 2])
        self.handle.visible = bool(len(poses))

    def paint(self, colours: NDArray[np.uint8]) -> None:
        """Colour the drops (N, 3), sRGB."""
        if len(colours):
            self.handle.batched_colors = palette.srgb_to_linear(colours)
