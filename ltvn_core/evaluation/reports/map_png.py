"""Draws the map of a recording as a small PNG image, for programs that cannot render SVG.

Owns the drawing. Positions and spurious edges come from the layout in `map_svg`.
"""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.evaluation.map_drawing import MapDrawing
from ltvn_core.evaluation.reports.map_svg import MapLayout, bar_length_m
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId

LONGER_SIDE = 1024
"""Length of the image's longer side in pixels, whatever the size of the map."""
_MARGIN = 24
_LABELS = 60
"""Maximum number of nodes that are labelled with their numbers."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


class _Canvas:
    """An image with coordinates in metres, x to the right and y up."""

    def __init__(self, plan: MapDrawing) -> None:
        low, high = _extent(plan)
        size_m = np.maximum(high - low, 0.5)
        self.scale = (LONGER_SIDE - 2 * _MARGIN) / float(size_m.max())
        width, height = (size_m * self.scale).astype(int) + 2 * _MARGIN
        self._low = low
        self._height = int(height)
        self.picture: NDArray[np.uint8] = np.full((int(height) + _MARGIN, int(width), 3), palette.BACKGROUND, np.uint8)

    def pixel(self, x: float, y: float) -> tuple[int, int]:
        """Return column and row of a place."""
        column, up = (np.array([x, y]) - self._low) * self.scale + _MARGIN
        return round(float(column)), self._height - round(float(up))

    def line(self, start: tuple[int, int], end: tuple[int, int], colour: Rgb8, width: int = 1) -> None:
        """Draw a line between two pixels."""
        cv2.line(self.picture, start, end, colour, width, cv2.LINE_AA)

    def write(self, at: tuple[int, int], words: str, size: float = 0.4) -> None:
        """Write words whose lower left corner is at a pixel."""
        cv2.putText(self.picture, words, at, _FONT, size, palette.TEXT, 1, cv2.LINE_AA)


def map_png(drawn: MapLayout) -> bytes:
    """Return the map as PNG: edges in the page's colours for p, spurious edges thick, and nodes, some with numbers."""
    canvas = _Canvas(drawn.plan)
    _draw_floor(canvas, drawn.plan)
    _draw_edges(canvas, drawn.plan)
    _draw_nodes(canvas, drawn.plan)
    _draw_legend(canvas, drawn)
    return cv2.imencode(".png", canvas.picture[..., ::-1])[1].tobytes()


def _extent(plan: MapDrawing) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the low and high corner (2,) of the floor, or of the nodes without a floor."""
    if plan.free:
        low = np.array(plan.origin)
        return low, low + np.array([len(plan.free[0]), len(plan.free)]) * plan.resolution_m
    places = np.array([node[1:3] for node in plan.nodes])
    return places.min(axis=0), places.max(axis=0)


def _draw_floor(canvas: _Canvas, plan: MapDrawing) -> None:
    if not plan.free:
        return
    taken = np.array([[cell == "#" for cell in row] for row in plan.free[::-1]], np.uint8)
    left, bottom = canvas.pixel(*plan.origin)
    size = tuple(max(1, round(cells * plan.resolution_m * canvas.scale)) for cells in taken.shape[::-1])
    walls = cv2.resize(taken, size, interpolation=cv2.INTER_NEAREST).astype(bool)
    top = max(0, bottom - walls.shape[0])
    part = canvas.picture[top : top + walls.shape[0], left : left + walls.shape[1]]
    part[walls[: part.shape[0], : part.shape[1]]] = palette.WALL


def _draw_edges(canvas: _Canvas, plan: MapDrawing) -> None:
    places = {node: (x, y) for node, x, y, _ in plan.nodes}
    # Spurious ones last, on top of all others.
    for source, target, p, wrong in sorted(plan.edges, key=lambda edge: edge[3]):
        red, green, blue = palette.probability_colours([p])[0].tolist()
        colour = palette.EDGE_REMOVED if wrong else Rgb8(red, green, blue)
        canvas.line(canvas.pixel(*places[source]), canvas.pixel(*places[target]), colour, 3 if wrong else 1)


def _draw_nodes(canvas: _Canvas, plan: MapDrawing) -> None:
    labelled = set(_labelled(plan))
    for node, x, y, _ in plan.nodes:
        at = canvas.pixel(x, y)
        cv2.circle(canvas.picture, at, 3, palette.NODE, -1, cv2.LINE_AA)
        if node in labelled:
            canvas.write((at[0] + 4, at[1] - 4), str(node))


def _labelled(plan: MapDrawing) -> Iterator[NodeId]:
    """Yield the ends of spurious edges, and other nodes at regular steps in the list."""
    yield from (node for source, target, _, wrong in plan.edges if wrong for node in (source, target))
    yield from (node for node, *_ in plan.nodes[:: max(1, len(plan.nodes) // _LABELS)])


def _draw_legend(canvas: _Canvas, drawn: MapLayout) -> None:
    row = canvas.picture.shape[0] - 8
    bar_m = bar_length_m(canvas.picture.shape[1] / canvas.scale)
    canvas.line((_MARGIN, row - 4), (_MARGIN + round(bar_m * canvas.scale), row - 4), palette.TEXT, 2)
    counts = f"{bar_m:g} m   {drawn.title}: {len(drawn.graph.nodes)} nodes, {len(drawn.graph.edges)} edges"
    spurious = "; thick: cannot be driven" if drawn.simulated else ""
    canvas.write((_MARGIN + round(bar_m * canvas.scale) + 8, row), counts + spurious)
