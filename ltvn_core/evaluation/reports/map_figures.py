"""Figures of maps over the floor plan: nodes with their yaw, edges coloured by p, spurious ones marked.

Owns the drawing. Free floor and spurious edges come with the results.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ltvn_core.evaluation.map_drawing import MapDrawing
from ltvn_core.evaluation.reports.figure_style import WIDTH_IN, Colour, FigurePalette, probability_colour_map
from ltvn_core.evaluation.results import TestedMap

_SPURIOUS: Colour = (0.85, 0.1, 0.25)
_TWO_IN_A_ROW = 4
_FULL_SIZE_NODES = 250
"""Largest number of nodes that are drawn in full size."""


class MapPanel(NamedTuple):
    """One map and its heading."""

    title: str
    trial: TestedMap


def map_figure(panels: Sequence[MapPanel], palette: FigurePalette) -> Figure:
    """Draw maps of one scene side by side: two in a row, or three if there are many.

    Trials without a floor plan are left out.
    """
    drawable = [(panel, plan) for panel in panels if (plan := panel.trial.floorplan) is not None]
    columns = 1 if len(drawable) < 2 else 2 if len(drawable) <= _TWO_IN_A_ROW else 3
    rows = max(math.ceil(len(drawable) / columns), 1)
    width_in = WIDTH_IN / max(columns, 2)
    size = (columns * width_in, 0.9 + rows * _height(drawable[0][1] if drawable else None, width_in))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(drawable) :]:
        axes.set_visible(False)
    for axes, (panel, plan) in zip(grid, drawable, strict=False):
        _draw(axes, plan, palette)
        facts = panel.trial.map
        axes.set_title(
            f"{panel.title}\n{facts.nodes:,} nodes, {facts.edges:,} edges, {facts.spurious_edges:,} spurious",
            fontsize=9.5 if columns < 3 else 7.5,
        )
    _legend(figure, list(grid), palette)
    return figure


def _height(plan: MapDrawing | None, width_in: float) -> float:
    """Return the height in inches of a panel that fits the scene's shape."""
    if plan is None or not plan.free:
        return 3.0
    return float(np.clip(0.45 + 0.98 * width_in * len(plan.free) / len(plan.free[0]), 1.5, 7.0))


def _draw(axes: Axes, plan: MapDrawing, palette: FigurePalette) -> None:
    _draw_floor(axes, plan, palette)
    _draw_edges(axes, plan, palette)
    nodes = np.array([node[1:] for node in plan.nodes]).reshape(-1, 3)
    size = min(1.0, (_FULL_SIZE_NODES / max(len(nodes), 1)) ** 0.7)
    axes.quiver(
        *nodes[:, :2].T,
        *(np.cos(nodes[:, 2]), np.sin(nodes[:, 2])),
        **{
            "color": palette.grey,
            "pivot": "tail",
            "scale": 34 / size,
            "width": 0.004 * size,
            "zorder": 4,
            "rasterized": True,
        },
    )
    axes.plot(*nodes[:, :2].T, "o", color=palette.grey, markersize=2.4 * size, zorder=4, rasterized=True)
    axes.set_aspect("equal")
    axes.axis("off")


def _draw_floor(axes: Axes, plan: MapDrawing, palette: FigurePalette) -> None:
    free = np.array([[cell == "." for cell in row] for row in plan.free])
    colours = np.zeros((*free.shape, 4))
    colours[~free] = (*palette.grey, 0.3)
    x, y = plan.origin
    height, width = (count * plan.resolution_m for count in free.shape)
    axes.imshow(colours, origin="lower", extent=(x, x + width, y, y + height), interpolation="nearest", zorder=0)


def _draw_edges(axes: Axes, plan: MapDrawing, palette: FigurePalette) -> None:
    places = {node: (x, y) for node, x, y, _ in plan.nodes}
    good = [(places[i], places[j]) for i, j, _, spurious in plan.edges if not spurious]
    p = np.array([p for *_, p, spurious in plan.edges if not spurious])
    thin = 0.9 if len(good) < 3000 else 0.35
    lines = LineCollection(good, cmap=probability_colour_map(), linewidths=thin, alpha=0.75, zorder=2, rasterized=True)
    lines.set_array(p)
    lines.set_clim(0, 1)
    axes.add_collection(lines)
    bad = [(places[i], places[j]) for i, j, _, spurious in plan.edges if spurious]
    axes.add_collection(LineCollection(bad, colors=[_SPURIOUS], linewidths=2 * thin, zorder=3, rasterized=True))
    if bad:
        axes.plot(*np.mean(bad, axis=1).T, "x", color=_SPURIOUS, markersize=4, zorder=5, rasterized=True)


def _legend(figure: Figure, axes: list[Axes], palette: FigurePalette) -> None:
    mappable = ScalarMappable(cmap=probability_colour_map())
    bar = figure.colorbar(mappable, ax=axes, location="bottom", shrink=0.4, aspect=40, pad=0.02)
    bar.set_label("p of the edge")
    bar.outline.set_visible(False)  # type: ignore[operator]
    spurious = Line2D([], [], color=_SPURIOUS, marker="x", label="spurious edge")
    node = Line2D([], [], color=palette.grey, marker="o", markersize=3, linestyle="", label="node")
    figure.legend(handles=[node, spurious], loc="outside upper left", ncols=2)
