"""Draws a map over the floor of its scene as SVG with a tooltip for every node and edge.

Owns the drawing; needs no other library than those of the core. Hovering a part shows its title in any browser.
"""

import base64
import math
from collections.abc import Iterator
from html import escape
from typing import NamedTuple

import cv2
import numpy as np

from ltvn_core import palette
from ltvn_core.evaluation.map_layout import MapLayout
from ltvn_core.evaluation.results import MapDrawing
from ltvn_core.graph.deltas import Edge
from ltvn_core.reports.map_legend import legend_height_m, map_legend

_MARGIN_M = 0.3
_NODE_M = 0.05
_YAW_M = 0.16
"""Length of the tick that shows a node's heading."""


class _Box(NamedTuple):
    x_m: float
    y_m: float
    width_m: float
    height_m: float


def map_svg(drawn: MapLayout) -> str:
    """Return a self-contained SVG in metres, x to the right and y up, with title, legend and scale bar below."""
    box = _box(drawn.plan)
    # A picture's y goes down, so everything is drawn with its sign turned.
    whole_m = box.height_m + legend_height_m(box.width_m)
    view = f"{box.x_m:.3f} {-(box.y_m + box.height_m):.3f} {box.width_m:.3f} {whole_m:.3f}"
    style = (
        f"text{{font:.25px sans-serif;fill:{palette.TEXT.css}}}.e{{stroke-width:.025;fill:none}}"
        f".e:hover,.e.on{{stroke-width:.07}}.n{{fill:{palette.NODE.css};stroke:{palette.NODE.css};stroke-width:.02}}"
        f".n:hover,.n.on{{stroke-width:.08}}"
        f".s{{stroke:{palette.EDGE_REMOVED.css};stroke-width:.05;stroke-dasharray:.12 .06}}"
    )
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" id="scene" viewBox="{view}" role="img">',
        f"<title>{escape(drawn.title)}</title><style>{style}</style>",
        f'<rect x="{box.x_m:.3f}" y="{-(box.y_m + box.height_m):.3f}" width="{box.width_m:.3f}" '
        f'height="{whole_m:.3f}" fill="{palette.BACKGROUND.css}"/>',
        *_floor(drawn.plan),
        *_edges(drawn),
        *_nodes(drawn),
        *map_legend(drawn, box.x_m, -box.y_m, box.width_m),
        "</svg>",
    ]
    return "\n".join(parts)


def _box(plan: MapDrawing) -> _Box:
    """Return the visible area: the floor, or all nodes."""
    if plan.free:
        return _Box(
            x_m=plan.origin[0],
            y_m=plan.origin[1],
            width_m=len(plan.free[0]) * plan.resolution_m,
            height_m=len(plan.free) * plan.resolution_m,
        )
    places = np.array([node[1:3] for node in plan.nodes])
    low = places.min(axis=0) - _MARGIN_M
    high = places.max(axis=0) + _MARGIN_M
    return _Box(x_m=float(low[0]), y_m=float(low[1]), width_m=float(high[0] - low[0]), height_m=float(high[1] - low[1]))


def _floor(plan: MapDrawing) -> Iterator[str]:
    """Draw the cells that are not navigable, as an image with one pixel per cell."""
    if not plan.free:
        return
    taken = np.array([[cell == "#" for cell in row] for row in plan.free[::-1]])
    pixels = np.zeros((*taken.shape, 4), np.uint8)
    pixels[taken] = (palette.WALL.blue, palette.WALL.green, palette.WALL.red, 255)
    data = base64.b64encode(cv2.imencode(".png", pixels)[1].tobytes()).decode()
    box = _box(plan)
    yield (
        f'<image x="{box.x_m:.3f}" y="{-(box.y_m + box.height_m):.3f}" width="{box.width_m:.3f}" '
        f'height="{box.height_m:.3f}" style="image-rendering:pixelated" href="data:image/png;base64,{data}"/>'
    )


def _edges(drawn: MapLayout) -> Iterator[str]:
    """Draw one line per pair of nodes, in the colour of its less likely direction."""
    places = {node: (x, -y) for node, x, y, _ in drawn.plan.nodes}
    spurious = {(source, target) for source, target, _, wrong in drawn.plan.edges if wrong}
    for pair in dict.fromkeys((min(key), max(key)) for key in drawn.graph.edges):
        back = pair[1], pair[0]
        both = [drawn.graph.edges[key] for key in (pair, back) if key in drawn.graph.edges]
        x1, y1 = places[pair[0]]
        x2, y2 = places[pair[1]]
        colour = _probability_css(min(edge.belief.p for edge in both))
        wrong = pair in spurious or back in spurious
        title = "\n".join(_edge_words(edge, (edge.source, edge.target) in spurious) for edge in both)
        yield (
            f'<path class="e{" s" if wrong else ""}" d="M{x1:.3f} {y1:.3f}L{x2:.3f} {y2:.3f}" '
            f'stroke="{colour}"><title>{escape(title)}</title></path>'
        )


def _edge_words(edge: Edge, spurious: bool) -> str:
    driven = f"driven {edge.attempts} x, {edge.successes} x with success" if edge.attempts else "never driven"
    words = f"edge {edge.source} to {edge.target}: p {edge.belief.p:.2f}, length {edge.belief.mu:.2f}, {driven}"
    words += ", by odometry" if edge.by_odometry else ""
    return words + (", spurious" if spurious else "") + (", protected" if edge.protected else "")


def _nodes(drawn: MapLayout) -> Iterator[str]:
    graph = drawn.graph
    for node, x, y, yaw in drawn.plan.nodes:
        tip = x + _YAW_M * math.cos(yaw), -y - _YAW_M * math.sin(yaw)
        out = len(graph.successors(node))
        back = len(graph.predecessors(node))
        title = f"node {node} at {x:.2f} m, {y:.2f} m, {math.degrees(yaw):.0f} degrees; {out} edges out, {back} in"
        yield (
            f'<g class="n"><path d="M{x:.3f} {-y:.3f}L{tip[0]:.3f} {tip[1]:.3f}"/>'
            f'<circle cx="{x:.3f}" cy="{-y:.3f}" r="{_NODE_M}"/><title>{title}</title></g>'
        )


def _probability_css(p: float) -> str:
    red, green, blue = palette.probability_colours([p])[0].tolist()
    return palette.Rgb8(red, green, blue).css
