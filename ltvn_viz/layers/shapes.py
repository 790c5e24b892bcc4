"""Shapes for the layers: positions and rotations of poses, and batches of lines, dots or drops that change in place."""

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from ltvn_core import palette
from ltvn_core.types import Pose

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices (V, 3) and faces (F, 3)."""


def points(xy: ArrayLike, height_m: float) -> NDArray[np.float32]:
    """Return (..., 3) points at a height from floor positions or poses (..., >=2)."""
    xy = np.asarray(xy, np.float32)[..., :2]
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), height_m, np.float32)], axis=-1)


def wxyz(yaw_rad: ArrayLike) -> NDArray[np.float32]:
    """Return quaternions (..., 4) of rotations about the vertical axis."""
    half = np.asarray(yaw_rad, np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1).astype(np.float32)


def marker_mesh(length_m: float, thickness_m: float) -> Mesh:
    """Return vertices (V, 3) and faces (F, 3) of a flat drop that points along x, which shows the heading of a pose."""
    angles = np.linspace(np.pi / 3, 2 * np.pi - np.pi / 3, 11)
    radius = length_m * 0.45
    rim = np.concatenate([radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), [[length_m, 0.0]]])
    n = len(rim)
    top = np.concatenate([rim, np.full((n, 1), thickness_m)], axis=1)
    bottom = np.concatenate([rim, np.zeros((n, 1))], axis=1)
    vertices = np.concatenate([top, bottom, [[0, 0, thickness_m], [0, 0, 0]]]).astype(np.float32)
    i = np.arange(n)
    j = (np.arange(n) + 1) % n
    roof = np.stack([i, j, np.full(n, 2 * n)], axis=1)
    floor = np.stack([j + n, i + n, np.full(n, 2 * n + 1)], axis=1)
    sides = np.concatenate([np.stack([i, i + n, j], axis=1), np.stack([j, i + n, j + n], axis=1)])
    return vertices, np.concatenate([roof, floor, sides]).astype(np.uint32)


_CORNERS = 8
"""Corners of a dot; few, because a map has many dots."""


def disc_mesh(radius_m: float) -> Mesh:
    """Return vertices (V, 3) and faces (F, 3) of a flat dot."""
    angles = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    rim = np.stack([radius_m * np.cos(angles), radius_m * np.sin(angles), np.zeros(_CORNERS)], axis=1)
    first = np.zeros(_CORNERS - 2, int)
    second = np.arange(1, _CORNERS - 1)
    return rim.astype(np.float32), np.stack([first, second, second + 1], axis=1).astype(np.uint32)


_RIM_PX = 1.0
_RIM_BELOW_M = 0.01
"""Depth below a line at which a dark rim is drawn, which separates pale lines from pale floors."""


class LineSegments:
    """Line segments of constant width on the screen."""

    def __init__(self, scene: viser.SceneApi, name: str, thickness_px: float, *, outlined: bool = False) -> None:
        """Add the node, empty and hidden."""
        self.handle = _line_batch(scene, name, thickness_px)
        self.outline = _line_batch(scene, f"{name}/outline", thickness_px + 2 * _RIM_PX) if outlined else None

    def draw(self, segments: NDArray[np.float32], colours: NDArray[np.uint8]) -> None:
        """Replace all segments (N, 2, 3) and their colours (N, 3), sRGB."""
        if len(segments):
            self.handle.points = segments
            self.handle.colors = np.repeat(palette.srgb_to_linear(colours)[:, None], 2, axis=1)
        # The page cannot draw a node without geometry, so an empty node is hidden.
        self.handle.visible = bool(len(segments))
        self._draw_outline(segments)

    def draw_path(self, poses: Pose, height_m: float, colour: palette.Rgb8, *, jump_m: float = np.inf) -> None:
        """Replace all segments by a path along poses (N, 3); steps of `jump_m` and more are left out."""
        line = points(poses, height_m)
        segments = np.stack([line[:-1], line[1:]], axis=1)
        segments = segments[np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1) < jump_m]
        self.draw(segments, np.full((len(segments), 3), colour, np.uint8))

    def _draw_outline(self, segments: NDArray[np.float32]) -> None:
        if self.outline is None:
            return
        if len(segments):
            self.outline.points = segments - np.array([0, 0, _RIM_BELOW_M], np.float32)
            dark = palette.srgb_to_linear(np.array([palette.BACKGROUND]))
            self.outline.colors = np.broadcast_to(dark, (len(segments), 2, 3))
        self.outline.visible = bool(len(segments))


def _line_batch(scene: viser.SceneApi, name: str, thickness_px: float) -> viser.LineSegmentsHandle:
    dummy = np.zeros((1, 2, 3), np.float32)
    return scene.add_line_segments(
        name, dummy, dummy.astype(np.uint8), thickness=thickness_px, thickness_units="screen", visible=False
    )


_RIM_M = 0.02
"""Width in metres of the dark rim that separates dots from a floor of the same colour."""
_DOT_M = 0.045
"""Radius of a dot, in metres."""
_DROP_THICK_M = 0.03


class Markers:
    """A batch of the same flat shape at many poses, drawn by a single draw call."""

    def __init__(self, scene: viser.SceneApi, name: str, mesh: Mesh, colour: palette.Rgb8) -> None:
        """Add the node, empty and hidden."""
        self.handle = scene.add_batched_meshes_simple(
            name,
            *mesh,
            batched_wxyzs=np.array([[1.0, 0.0, 0.0, 0.0]]),
            batched_positions=np.zeros((1, 3)),
            batched_colors=palette.srgb_to_linear(np.array([colour])),
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def place(self, poses: Pose, height_m: float) -> None:
        """Place one shape at each of the poses (N, 3); without poses, the node is hidden."""
        if len(poses):
            self.handle.batched_positions = points(poses, height_m)
            self.handle.batched_wxyzs = wxyz(poses[:, 2])
        self.handle.visible = bool(len(poses))

    def paint(self, colours: NDArray[np.uint8]) -> None:
        """Colour the shapes (N, 3), sRGB."""
        if len(colours):
            self.handle.batched_colors = palette.srgb_to_linear(colours)


def drops(scene: viser.SceneApi, name: str, length_m: float, colour: palette.Rgb8 = palette.NODE) -> Markers:
    """Add flat drops that point along the headings of poses."""
    return Markers(scene, name, marker_mesh(length_m, _DROP_THICK_M), colour)


class Dots:
    """A batch of small dots, and below it a batch of larger dark dots as their outline."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        """Add both batches, empty and hidden."""
        self.dots = Markers(scene, name, disc_mesh(_DOT_M), palette.NODE)
        self.outline = Markers(scene, f"{name}/outline", disc_mesh(_DOT_M + _RIM_M), palette.BACKGROUND)

    def place(self, poses: Pose, height_m: float) -> None:
        """Place one dot at each of the poses (N, 3); without poses, the dots are hidden."""
        self.dots.place(poses, height_m)
        self.outline.place(poses, height_m - _RIM_BELOW_M)

    def paint(self, colours: NDArray[np.uint8]) -> None:
        """Colour the dots (N, 3), sRGB."""
        self.dots.paint(colours)
