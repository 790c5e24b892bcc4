"""A map in its scene as one HTML file that needs no network: viser's client with all data included.

Owns the content of the file: walls, nodes, edges, a legend, and a content policy that allows no requests. The flat
figure, with the numbers of every node and edge, is `evaluation.reports.map_svg`.
"""

from html import escape
from pathlib import Path

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import SceneError
from ltvn_core.evaluation.reports.map_svg import MapLayout, bar_length_m
from ltvn_core.terminal_text import count_text
from ltvn_viz.layers import CHANGE_Z, EDGE_Z, NODE_Z
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.floor_plan import draw_floor_plan
from ltvn_viz.layers.graph_layers import EdgeLines, offset_right
from ltvn_viz.layers.scene_assets import add_lights, floor_bounds, scene_glb
from ltvn_viz.layers.shapes import Dots, LineSegments, points
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.index_page import mended

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; worker-src blob:; style-src 'unsafe-inline'; "
    "img-src blob: data:; font-src data:; connect-src blob: data:; base-uri 'none'; form-action 'none'"
)
"""Content security policy: everything is in the file, so the browser loads nothing else."""

BAR_BEFORE_M, BAR_TICK_M = 0.4, 0.12
"""Distance of the scale bar in front of the floor, and half the length of its ticks, in metres."""


def scene_html(recording: Recording, drawn: MapLayout) -> str:
    """Return a page with a 3D view that one rotates, moves and zooms by mouse or touch. Takes seconds; raises
    ServerError.

    If the scene is neither installed nor in the recording, the page shows the map without it.
    """
    # Only a server can export viser's scene. Its key is never shown, so nobody else can connect.
    with GuardedServer() as server:
        walls = _walls(recording)
        if walls is not None:
            server.scene.add_glb("/apartment", walls, cast_shadow=False, receive_shadow=False)
        if drawn.floor_plan is not None:
            draw_floor_plan(server.scene, drawn.floor_plan)
        add_lights(server.scene)
        poses = np.array([row[1:] for row in drawn.plan.nodes])
        _draw(server.scene, drawn, poses)
        known = floor_bounds(recording.meta.scene)
        low, high = known or (poses[:, :2].min(axis=0) - 1.0, poses[:, :2].max(axis=0) + 1.0)
        _lay_scale_bar(server.scene, low, high)
        Floor(low - (0.0, 2 * BAR_BEFORE_M), high).begin(server.viser)
        return _finished(server.scene.as_html(dark_mode=True), drawn)


def _walls(recording: Recording) -> bytes | None:
    try:
        return scene_glb(recording.meta.scene)
    except SceneError:
        return recording.scene_glb()


def _draw(scene: viser.SceneApi, drawn: MapLayout, poses: NDArray[np.float64]) -> None:
    """Draw nodes at poses (N, 3), edges by their belief, and false edges."""
    rows = {row[0]: number for number, row in enumerate(drawn.plan.nodes)}
    nodes = Dots(scene, "/graph/nodes")
    nodes.place(poses, NODE_Z)
    nodes.paint(np.full((len(poses), 3), palette.NODE, np.uint8))
    ends = np.array([(rows[source], rows[target]) for source, target, *_ in drawn.plan.edges], int).reshape(-1, 2)
    p = np.array([row[2] for row in drawn.plan.edges])
    spurious = np.array([row[3] for row in drawn.plan.edges], bool)
    segments = offset_right(poses[:, :2][ends])
    EdgeLines(scene, "/graph/edges").draw(points(segments, EDGE_Z), p)
    wrong = np.full((int(spurious.sum()), 3), palette.EDGE_REMOVED, np.uint8)
    LineSegments(scene, "/graph/spurious", 5.0).draw(points(segments[spurious], CHANGE_Z), wrong)


def _lay_scale_bar(scene: viser.SceneApi, low: NDArray[np.floating], high: NDArray[np.floating]) -> None:
    """Add a bar of known length on the floor, in front of the corner `low` (2,)."""
    length = bar_length_m(float(high[0] - low[0]))
    start = np.array([low[0], low[1] - BAR_BEFORE_M, 0.0], np.float32)
    end = start + np.array([length, 0, 0], np.float32)
    tick = np.array([0, BAR_TICK_M, 0], np.float32)
    bar = np.stack([np.stack([start, end]), np.stack([start - tick, start + tick]), np.stack([end - tick, end + tick])])
    LineSegments(scene, "/scale/bar", 3.0).draw(bar, np.full((len(bar), 3), palette.TEXT, np.uint8))
    scene.add_label("/scale/label", f"{length:g} m", position=(start + end) / 2 - 2 * tick)


def _finished(html: str, drawn: MapLayout) -> str:
    """Add title, legend and content policy to viser's page."""
    if html.count("<title>Viser</title>") != 1 or html.count("<body>") != 1 or html.count("<head>") != 1:
        raise RuntimeError(f"viser {viser.__version__} has another page than expected")
    graph = drawn.graph
    wrong = sum(row[3] for row in drawn.plan.edges)
    template = (Path(__file__).parents[1] / "static" / "scene_legend.html").read_text(encoding="utf-8")
    legend = template.format(
        title=escape(drawn.title),
        counts=f"{count_text(len(graph.nodes), 'node')}, {count_text(len(graph.edges), 'edge')}",
        ramp=palette.gradient_css(palette.PROBABILITY_RAMP),
        wrong=f'<div><b style="color:{palette.EDGE_REMOVED.css}">━</b> nobody can drive it: {wrong}</div>'
        if drawn.simulated
        else "",
    )
    html = mended(html).replace("<head>", f'<head><meta http-equiv="Content-Security-Policy" content="{POLICY}">')
    html = html.replace("<title>Viser</title>", f"<title>{escape(drawn.title)}</title>")
    return html.replace("<body>", f"<body>{legend}")
