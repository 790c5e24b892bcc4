"""One fixed scene node of many line segments that changes in place."""

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette

OUTLINE_PX, OUTLINE_BELOW_M = 1.0, 0.01
"""A dark rim of so many pixels, drawn by so much below, tells pale lines from pale floors."""


class LineSegments:
    """Line segments of constant width on the screen."""

    def __init__(self, scene: viser.SceneApi, name: str, thickness_px: float, *, outlined: bool = False) -> None:
        """Add the node, empty and hidden."""
        self.handle = _batch(scene, name, thickness_px)
        self.outline = _batch(scene, f"{name}/outline", thickness_px + 2 * OUTLINE_PX) if outlined else None

    def draw(self, segments: NDArray[np.float32], colours: NDArray[np.uint8]) -> None:
        """Replace all segments (N, 2, 3) and their colours (N, 3), sRGB."""
        if len(segments):
            self.handle.points = segments
            self.handle.colors = np.repeat(palette.srgb_to_linear(colours)[:, None], 2, axis=1)
        # A node without geometry is not something the page can draw, so an empty one is hidden.
        self.handle.visible = bool(len(segments))
        self._draw_outline(segments)

    def _draw_outline(self, segments: NDArray[np.float32]) -> None:
        if self.outline is None:
            return
        if len(segments):
            self.outline.points = segments - np.array([0, 0, OUTLINE_BELOW_M], np.float32)
            dark = palette.srgb_to_linear(np.array([palette.BACKGROUND]))
            self.outline.colors = np.broadcast_to(dark, (len(segments), 2, 3))
        self.outline.visible = bool(len(segments))


def _batch(scene: viser.SceneApi, name: str, thickness_px: float) -> viser.LineSegmentsHandle:
    dummy = np.zeros((1, 2, 3), np.float32)
    return scene.add_line_segments(
        name, dummy, dummy.astype(np.uint8), thickness=thickness_px, thickness_units="screen", visible=False
    )
