"""The robot's camera beside the map: a larger picture for people if there is one, and what the method sees.

Owns the encoding of the method's colour and depth in one image, so that they always match. The page enlarges them, or
shows them in a corner of the larger picture (`static/pictures.js`, `static/layout.css`).
"""

import time
from collections.abc import Callable

import cv2
import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.types import Depth, Rgb
from ltvn_viz.panels.html_widgets import HtmlBlock
from ltvn_viz.session.snapshot import CameraImage, Snapshot

EMPTY_SIZE = (96, 72)
"""Columns and rows of the placeholder while there is no image."""
MOST_COLUMNS = 640
"""Maximum number of columns; larger images are scaled down."""
GAP = 8
"""Number of columns between colour and depth, so that neither bleeds into the other."""
SHOW_EVERY_S = 1 / 15
QUALITY = 95
"""JPEG quality, high enough to keep each pixel that the method uses; the images are small."""
FARTHEST_M = 6.0
"""Depth in metres beyond which everything has the same colour."""


class CameraPanel:
    """Sends the camera picture and its caption."""

    def __init__(
        self,
        gui: viser.GuiApi,
        send: Callable[[bytes], None],
        send_larger: Callable[[bytes], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Send each image as a JPEG by `send`, and after a byte 0 the larger one by `send_larger`; the page copies the
        caption from the open panel."""
        self._send = send
        self._send_larger = send_larger
        self._larger = b""
        self._caption = HtmlBlock(gui)
        self._clock = clock
        self.shown: CameraImage | None = None
        self._due = float("-inf")

    def show(self, snapshot: Snapshot) -> None:
        """Show the newest images if they differ, the method's at most 15 times a second."""
        if snapshot.larger != self._larger:
            self._larger = snapshot.larger
            self._send_larger(b"\0" + self._larger)
        if snapshot.camera is self.shown or self._clock() < self._due:
            return
        is_same = _look_the_same(snapshot.camera, self.shown)
        self.shown = snapshot.camera
        if is_same:
            return
        self._due = self._clock() + SHOW_EVERY_S
        self._send(_jpeg(colour_beside_depth(snapshot.camera)))
        self._caption.show(caption(snapshot.camera))


def _look_the_same(one: CameraImage | None, other: CameraImage | None) -> bool:
    if one is None or other is None:
        return one is other
    if one.depth is None or other.depth is None:
        return one.depth is other.depth and np.array_equal(one.rgb, other.rgb)
    return np.array_equal(one.rgb, other.rgb) and np.array_equal(one.depth, other.depth)


def caption(view: CameraImage | None) -> str:
    """Return a description of the method's image."""
    if view is None:
        return ""
    height, width = view.rgb.shape[:2]
    text = f"What the method sees: {width} x {height} pixels" + (", no depth" if view.depth is None else "")
    has_depth = int(view.depth is not None)
    return f'<div class="ltvn-elsewhere" data-ltvn-copy="caption"><span data-depth="{has_depth}">{text}</span></div>'


def colour_beside_depth(view: CameraImage | None) -> Rgb:
    """Return colour and depth side by side in one image, each of the size of the image on show; missing parts are
    dark."""
    colour = np.empty((0, 0, 3), np.uint8) if view is None else _at_most(view.rgb)
    rows, columns = colour.shape[:2] if colour.size else EMPTY_SIZE[::-1]
    canvas = np.full((rows, 2 * columns + GAP, 3), palette.BACKGROUND, np.uint8)
    if colour.size:
        canvas[:, :columns] = colour
    if view is not None and view.depth is not None:
        depth = cv2.resize(view.depth, (columns, rows), interpolation=cv2.INTER_NEAREST).astype(np.float32)
        canvas[:, columns + GAP :] = depth_colours(depth)
    return canvas


def _at_most(rgb: Rgb) -> Rgb:
    rows, columns = rgb.shape[:2]
    if columns <= MOST_COLUMNS:
        return rgb
    size = MOST_COLUMNS, max(1, round(rows * MOST_COLUMNS / columns))
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def _jpeg(image: Rgb) -> bytes:
    # No chroma subsampling: otherwise two by two pixels would share a colour.
    how = (cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    return cv2.imencode(".jpg", image[..., ::-1], how)[1].tobytes()


def depth_colours(depth: Depth) -> Rgb:
    """Colour depth (H, W): near is light, far is dark, no return is black."""
    near = np.clip(1 - np.sqrt(depth / FARTHEST_M), 0, 1)  # The square root gives most colours to near depths.
    coloured = cv2.applyColorMap((255 * near).astype(np.uint8), cv2.COLORMAP_CIVIDIS).astype(np.uint8)
    coloured[depth <= 0] = 0
    return np.ascontiguousarray(coloured[..., ::-1])
