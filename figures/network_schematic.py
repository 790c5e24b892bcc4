"""A picture of the network: what happens to one image, and what happens to two.

Owns the drawing. Its sizes come from the `PairArchitecture` that travels with the weights.
"""

from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from ltvn_core.evaluation.reports.figure_style import Colour, FigurePalette
from ltvn_core.network.architecture import PairArchitecture

_WIDTH = 1.75
_HEIGHT = 0.95
"""Size of a box, in units of the drawing."""


def network_schematic(size: PairArchitecture, palette: FigurePalette) -> Figure:
    """Draw the network of an architecture."""
    figure = Figure(figsize=(8.4, 3.85), layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-0.05, 10.55), ylim=(0.55, 5.25), aspect="equal")
    axes.axis("off")
    _once_per_image(axes, size, palette)
    _once_per_pair(axes, palette)
    return figure


def _once_per_image(axes: Axes, size: PairArchitecture, palette: FigurePalette) -> None:
    rows, columns = size.grid
    axes.text(0, 5.05, "Once per image, the same encoder for both", weight="bold", va="center")
    for y, name, colour in ((3.75, "Source", palette.first), (2.45, "Target", palette.second)):
        _box(axes, 0.0, y, f"{name}\nRGB + depth\n96 × 72", colour)
        _box(axes, 2.2, y, "Encoder\nconvolutions,\nself-attention", colour)
        _box(axes, 4.4, y, f"{size.token_count} tokens\n{rows} × {columns}, each\nwith a 3D point", colour)
        _arrow(axes, (_WIDTH, y + _HEIGHT / 2), (2.2, y + _HEIGHT / 2), palette.grey)
        _arrow(axes, (2.2 + _WIDTH, y + _HEIGHT / 2), (4.4, y + _HEIGHT / 2), palette.grey)
        _arrow(axes, (4.4 + _WIDTH, y + _HEIGHT / 2), (6.6, 3.1 + _HEIGHT / 2), palette.grey)


def _once_per_pair(axes: Axes, palette: FigurePalette) -> None:
    axes.text(6.6, 5.05, "Once per pair", weight="bold", va="center")
    _box(axes, 6.6, 3.1, "Matching\nof tokens,\nboth ways", palette.third)
    _box(axes, 8.75, 3.1, "Alignment\nof the matches\non the floor", palette.third)
    steps = (
        (8.75, "Matching again\nknowing what\nlies where"),
        (6.6, "Alignment\nagain"),
        (4.4, "Verification\ndo both depth\nimages fit?"),
        (2.2, "Head\nweighs what\ncame of it"),
    )
    for x, text in steps:
        _box(axes, x, 0.7, text, palette.third)
    middle = 0.7 + _HEIGHT / 2
    _arrow(axes, (6.6 + _WIDTH, 3.1 + _HEIGHT / 2), (8.75, 3.1 + _HEIGHT / 2), palette.grey)
    _arrow(axes, (8.75 + _WIDTH / 2, 3.1), (8.75 + _WIDTH / 2, 0.7 + _HEIGHT), palette.grey)
    for (start, _), (end, _) in pairwise(steps):
        _arrow(axes, (start, middle), (end + _WIDTH, middle), palette.grey)
    _arrow(axes, (2.2, middle), (_WIDTH, middle), palette.grey)
    _box(axes, 0.0, 0.7, "r: reachable?\ndx, dy, dθ:\nwhere?", palette.text)


def _box(axes: Axes, x: float, y: float, text: str, colour: Colour) -> None:
    pale = tuple(1 - 0.14 * (1 - part) for part in colour)
    axes.add_patch(
        FancyBboxPatch(
            (x, y), _WIDTH, _HEIGHT, boxstyle="round,pad=0,rounding_size=0.12", facecolor=pale, edgecolor=colour, lw=1.6
        )
    )
    title, *rest = text.split("\n")
    lines = len(rest) + 1
    top = y + _HEIGHT / 2 + (lines - 1) * 0.135
    axes.text(x + _WIDTH / 2, top, title, ha="center", va="center", weight="bold", fontsize=9.5)
    for number, line in enumerate(rest, start=1):
        axes.text(x + _WIDTH / 2, top - 0.27 * number, line, ha="center", va="center", fontsize=9)


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: Colour) -> None:
    axes.add_patch(
        FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=12, color=colour, lw=1.4, shrinkA=2, shrinkB=2)
    )
