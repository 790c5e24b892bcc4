"""One fixed scene node of many flat drops that point where a place looks, and that change in place."""

from collections.abc import Callable, Coroutine

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.types import Pose
from ltvn_viz.layers.pose_geometry import marker_mesh, points, wxyz

OUTLINE_M = 0.035
"""Drops on a floor of their own colour are told from it by a dark rim of this width."""


class PoseMarkers:
    """A batch of drops, and a batch of larger dark ones right below, which is their outline."""

    def __init__(self, scene: viser.SceneApi, name: str, length_m: float, *, outlined: bool = False) -> None:
        """Add the node, empty and hidden."""
        self.handle = _batch(scene, name, length_m, 0.03, palette.NODE)
        self.outline = (
            _batch(scene, f"{name}/outline", length_m + 2 * OUTLINE_M, 0.01, palette.BACKGROUND) if outlined else None
        )

    def on_click(self, picked: Callable[[viser.SceneNodePointerEvent], Coroutine[None, None, None]]) -> None:
        """Call this when a drop or its outline is clicked."""
        for handle in self._handles:
            handle.on_click(picked)

    @property
    def _handles(self) -> list[viser.BatchedMeshHandle]:
        return [self.handle] if self.outline is None else [self.handle, self.outline]

    def place(self, poses: Pose, height_m: float) -> None:
        """Put the drops at poses (N, 3), as many as there are; none hides the node."""
        if len(poses):
            for handle in self._handles:
                handle.batched_positions = points(poses, height_m)
                handle.batched_wxyzs = wxyz(poses[:, 2])
        for handle in self._handles:
            handle.visible = bool(len(poses))

    def paint(self, colours: NDArray[np.uint8]) -> None:
        """Colour the drops (N, 3), sRGB."""
        if len(colours):
            self.handle.batched_colors = palette.srgb_to_linear(colours)


def _batch(
    scene: viser.SceneApi, name: str, length_m: float, thickness_m: float, colour: palette.Rgb8
) -> viser.BatchedMeshHandle:
    vertices, faces = marker_mesh(length_m, thickness_m)
    return scene.add_batched_meshes_simple(
        name,
        vertices,
        faces,
        batched_wxyzs=np.array([[1.0, 0.0, 0.0, 0.0]]),
        batched_positions=np.zeros((1, 3)),
        batched_colors=palette.srgb_to_linear(np.array([colour])),
        lod="off",
        flat_shading=True,
        cast_shadow=False,
        receive_shadow=False,
        visible=False,
    )
