"""What the robot sees: the image and its depth beside it."""

import time
from collections.abc import Callable

import cv2
import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.types import Depth, Rgb
from ltvn_viz.panels.html_widgets import HtmlBlock
from ltvn_viz.session.snapshot import CameraImage, ImageSource, Snapshot

WIDTH, HEIGHT = 320, 240
GAP = 6
SHOW_EVERY_S = 1 / 15
QUALITY = 85
FARTHEST_M = 6.0
"""Everything beyond has one colour."""


class CameraPanel:
    """One image with both, so that they always belong together; the page shows it beside the scene."""

    def __init__(
        self, gui: viser.GuiApi, send: Callable[[bytes], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Let `send` take each image as a JPEG; the caption is copied by the page from the panel that is open."""
        self._send, self._caption = send, HtmlBlock(gui)
        self._clock = clock
        self.shown: CameraImage | None = None
        self._due = float("-inf")

    def show(self, snapshot: Snapshot) -> None:
        """Show the newest image, at most 15 times a second."""
        if snapshot.camera is self.shown or self._clock() < self._due:
            return
        self.shown, self._due = snapshot.camera, self._clock() + SHOW_EVERY_S
        self._send(_jpeg(colour_beside_depth(snapshot.camera)))
        self._caption.show(caption(snapshot.camera))


def caption(view: CameraImage | None) -> str:
    """Say which image is on show."""
    if view is None:
        return ""
    match view.source:
        case ImageSource.OBSERVATION:
            height, width = view.rgb.shape[:2]
            text = f"What the method sees: {width} x {height} pixels" + (", no depth" if view.depth is None else "")
        case ImageSource.RENDERED:
            text = "Rendered larger for you; the method sees a smaller image"
    has_depth = int(view.depth is not None)
    return f'<div class="ltvn-elsewhere" data-ltvn-copy="caption"><span data-depth="{has_depth}">{text}</span></div>'


def colour_beside_depth(view: CameraImage | None) -> Rgb:
    """Return colour and depth, each 320 x 240, as one image."""
    canvas = np.full((HEIGHT, 2 * WIDTH + GAP, 3), palette.BACKGROUND, np.uint8)
    if view is not None:
        canvas[:, :WIDTH] = cv2.resize(view.rgb, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    if view is not None and view.depth is not None:
        depth = cv2.resize(view.depth, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST).astype(np.float32)
        canvas[:, WIDTH + GAP :] = depth_colours(depth)
    return canvas


def _jpeg(image: Rgb) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].tobytes()


def depth_colours(depth: Depth) -> Rgb:
    """Colour depth (H, W): near is light, far is dark, no return is black."""
    near = np.clip(1 - np.sqrt(depth / FARTHEST_M), 0, 1)  # The root leaves most colours to what is close.
    coloured = cv2.applyColorMap((255 * near).astype(np.uint8), cv2.COLORMAP_CIVIDIS).astype(np.uint8)
    coloured[depth <= 0] = 0
    return np.ascontiguousarray(coloured[..., ::-1])
