"""One fixed scene node of many line segments that changes in place."""

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette


class LineSegments:
    """Line segments of constant width on the screen."""

    def __init__(self, scene: viser.SceneApi, name: str, thickness_px: float) -> None:
        """Add the node, empty and hidden."""
        dummy = np.zeros((1, 2, 3), np.float32)
        self.handle = scene.add_line_segments(
            name, dummy, dummy.astype(np.uint8), thickness=thickness_px, thickness_units="screen", visible=False
        )

    def draw(self, segments: NDArray[np.float32], colours: NDArray[np.uint8]) -> None:
        """Replace all segments (N, 2, 3) and their colours (N, 3), sRGB."""
        if len(segments):
            self.handle.points = segments
            self.handle.colors = np.repeat(palette.srgb_to_linear(colours)[:, None], 2, axis=1)
        # A node without geometry is not something the page can draw, so an empty one is hidden.
        self.handle.visible = bool(len(segments))
