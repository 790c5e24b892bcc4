"""Draws the map of a recording as SVG, over the floor of its scene, with a tooltip for every node and edge.

Nodes are drawn at their exact poses over the floor if both are known, else at their odometry poses without a floor.
Title, legend and scale bar are below the map, so that the figure explains itself. Uses only libraries of the core;
every browser shows the tooltips.
"""

import base64
import math
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import cv2
import numpy as np

from ltvn_core import palette
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError, SceneError
from ltvn_core.evaluation.ground_truth import GroundTruth, floorplan
from ltvn_core.evaluation.map_drawing import MapDrawing
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.types import FrameId, Pose


@dataclass(frozen=True, eq=False)
class MapLayout:
    """A map with the positions of its nodes and the floor."""

    title: str
    graph: TopologicalGraph
    plan: MapDrawing
    """Nodes and edges; outside simulation, without floor and without spurious edges."""
    simulated: bool
    """Whether the ground truth is known."""
    floor_plan: FloorPlan | None = None
    """Floor plan of the building under the map; None if there is none."""


def map_layout(recording: Recording, *, at_s: float | None = None) -> MapLayout:
    """Return the layout of the map at a time on the robot's clock, by default at the end.

    Raises MapError when there is no map at that time. Without the scene there is no floor.
    """
    graph = TopologicalGraph(
        stamped.event.delta
        for stamped in recording.events
        if isinstance(stamped.event, GraphChanged) and (at_s is None or stamped.stamp <= at_s)
    )
    if not graph.nodes:
        raise MapError(f"{recording.path} holds no map at that time; `ltvn info {recording.path}` says what it holds.")
    title = recording.path.name if at_s is None else f"{recording.path.name} at {at_s:.1f} s"
    truth = recorded_ground_truth(recording, graph)
    if truth is not None:
        return MapLayout(title=title, graph=graph, plan=floorplan(graph, truth), simulated=True)
    return MapLayout(title=title, graph=graph, plan=_by_odometry(graph), simulated=False)


def recorded_ground_truth(recording: Recording, graph: TopologicalGraph) -> GroundTruth | None:
    """Return the ground truth of a recording; None if its scene is missing or a node has no exact pose."""
    poses = exact_poses(recording)
    if poses is None or any(node not in poses for node in graph.nodes):
        return None
    try:
        from ltvn_core.simulation.scene_registry import load_scene

        clearance = load_scene(recording.meta.scene).clearance
    except (SceneError, ModuleNotFoundError):
        return None
    return GroundTruth(clearance, recording.observation, poses=poses)


def exact_poses(recording: Recording) -> dict[FrameId, Pose] | None:
    """Return the exact pose (3,) of each frame without decoding images; None outside simulation."""
    poses = recording.poses
    return None if poses.exact is None else dict(zip(recording.frames, poses.exact, strict=True))


def _by_odometry(graph: TopologicalGraph) -> MapDrawing:
    poses = ((node.id, node.odometry) for node in graph.nodes.values())
    nodes = tuple((name, pose.x_m, pose.y_m, pose.yaw_rad) for name, pose in poses)
    corner = np.array([row[1:3] for row in nodes]).min(axis=0)
    edges = tuple((*key, edge.belief.p, False) for key, edge in graph.edges.items())
    return MapDrawing(origin=(float(corner[0]), float(corner[1])), resolution_m=0.05, free=(), nodes=nodes, edges=edges)


_MARGIN_M = 0.3
_PLAN_MARGIN_M = 2.0
"""Margin around the nodes in which a floor plan is visible, in metres."""
_PLAN_PX = 2048
_NODE_M = 0.05
_YAW_M = 0.16
"""Length of the line that shows a node's heading, in metres."""


class _Box(NamedTuple):
    x_m: float
    y_m: float
    width_m: float
    height_m: float


def map_svg(drawn: MapLayout) -> str:
    """Return a self-contained SVG in metres, x to the right and y up, with title, legend and scale bar below."""
    box = _box(drawn.plan, _MARGIN_M if drawn.floor_plan is None else _PLAN_MARGIN_M)
    # The y axis of an image points down, so everything is drawn with negated y.
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
        *_floor_plan(drawn.floor_plan),
        *_edges(drawn),
        *_nodes(drawn),
        *map_legend(drawn, box.x_m, -box.y_m, box.width_m),
        "</svg>",
    ]
    return "\n".join(parts)


def _box(plan: MapDrawing, margin_m: float = _MARGIN_M) -> _Box:
    """Return the visible area: the floor, or all nodes with a margin."""
    if plan.free:
        return _Box(
            x_m=plan.origin[0],
            y_m=plan.origin[1],
            width_m=len(plan.free[0]) * plan.resolution_m,
            height_m=len(plan.free) * plan.resolution_m,
        )
    places = np.array([node[1:3] for node in plan.nodes])
    low = places.min(axis=0) - margin_m
    high = places.max(axis=0) + margin_m
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


def _floor_plan(plan: FloorPlan | None) -> Iterator[str]:
    """Draw a floor plan as an image with one unit per cell, scaled and moved to its place by a transform."""
    if plan is None:
        return
    pixels = cv2.cvtColor(plan.picture(_PLAN_PX), cv2.COLOR_RGBA2BGRA)
    data = base64.b64encode(cv2.imencode(".png", pixels)[1].tobytes()).decode()
    height, width = plan.cells.shape
    x, y, yaw = map(float, plan.corner)
    cos, sin = plan.resolution_m * math.cos(yaw), plan.resolution_m * math.sin(yaw)
    move = f"{cos:.9f} {-sin:.9f} {sin:.9f} {cos:.9f} {x - sin * height:.6f} {-y - cos * height:.6f}"
    yield (
        f'<image width="{width}" height="{height}" transform="matrix({move})" preserveAspectRatio="none" '
        f'style="image-rendering:pixelated" href="data:image/png;base64,{data}"/>'
    )


def _edges(drawn: MapLayout) -> Iterator[str]:
    """Draw one line per pair of nodes, in the colour of the direction with the lower p."""
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


_TEXT_SHARE = 0.022
"""Height of letters as a share of the figure's width."""
_BAR_SHARE = 0.25
"""Largest length of the scale bar as a share of the figure's width."""
_SHORTEST_M = 0.01
_LINES = 4.5
"""Height of the legend below the map, in heights of its letters."""


def bar_length_m(width_m: float) -> float:
    """Return a round length (1, 2 or 5 times a power of ten, metres) for the scale bar of a map of that width."""
    most = max(_BAR_SHARE * width_m, _SHORTEST_M)
    return max(length for power in range(-2, 5) for factor in (1, 2, 5) if (length := factor * 10.0**power) <= most)


def legend_height_m(width_m: float) -> float:
    """Return the height in metres of the legend below a map of that width."""
    return _LINES * _TEXT_SHARE * width_m


def map_legend(drawn: MapLayout, left_m: float, top_m: float, width_m: float) -> Iterator[str]:
    """Yield the SVG elements of the legend below the map, in metres, with y down."""
    letter = _TEXT_SHARE * width_m
    counts = f"{len(drawn.graph.nodes):,} nodes (the tick: where the camera looked), {len(drawn.graph.edges):,} edges"
    first = top_m + 1.5 * letter
    second = top_m + 3.4 * letter
    left = left_m + letter
    yield f'<g font-size="{letter:.4f}" style="font-family:sans-serif" fill="{palette.TEXT.css}">'
    yield _text(left, first, f"{drawn.title}: {counts}", letter)
    yield from _scale_bar(left, second, width_m, letter)
    yield from _ramp(left + (_BAR_SHARE + 0.1) * width_m, second, letter)
    if drawn.simulated:
        yield from _spurious(left + (_BAR_SHARE + 0.37) * width_m, second, letter)
    yield "</g>"


def _scale_bar(left: float, base: float, width_m: float, letter: float) -> Iterator[str]:
    length = bar_length_m(width_m)
    height = 0.4 * letter
    yield (
        f'<path d="M{left:.3f} {base - height:.3f}v{height:.3f}h{length:.3f}v{-height:.3f}" '
        f'style="fill:none;stroke:{palette.TEXT.css};stroke-width:{0.1 * letter:.4f}"/>'
    )
    yield _text(left + length + 0.5 * letter, base, f"{length:g} m", letter)


def _ramp(left: float, base: float, letter: float) -> Iterator[str]:
    stops = "".join(
        f'<stop offset="{number / (len(palette.PROBABILITY_RAMP) - 1):g}" '
        f'stop-color="{palette.Rgb8(*map(int, stop)).css}"/>'
        for number, stop in enumerate(palette.PROBABILITY_RAMP)
    )
    yield f'<defs><linearGradient id="ramp">{stops}</linearGradient></defs>'
    yield _text(left, base, "edge p 0", letter)
    yield (
        f'<rect x="{left + 4.6 * letter:.3f}" y="{base - 0.65 * letter:.3f}" width="{4 * letter:.3f}" '
        f'height="{0.6 * letter:.3f}" fill="url(#ramp)"/>'
    )
    yield _text(left + 9 * letter, base, "1", letter)


def _spurious(left: float, base: float, letter: float) -> Iterator[str]:
    middle = base - 0.35 * letter
    yield f'<path class="s" d="M{left:.3f} {middle:.3f}h{2 * letter:.3f}"/>'
    yield _text(left + 2.4 * letter, base, "cannot be driven", letter)


def _text(x: float, y: float, words: str, letter: float) -> str:
    # The legend sets its own font size, because the figure's style has another one for text in the map.
    return f'<text x="{x:.3f}" y="{y:.3f}" style="font-size:{letter:.4f}px">{escape(words)}</text>'
