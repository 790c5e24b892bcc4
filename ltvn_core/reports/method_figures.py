"""Figures that compare methods: success, size of the graph, causes of failure.

Owns their drawing. The numbers come in rows.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.reports.evaluation_style import WIDTH_IN, cause_colour, in_counts, in_percent, method_colours
from ltvn_core.reports.figure_style import Colour, FigurePalette
from ltvn_core.reports.result_rows import ALL_SCENES, ResultRow, methods_of, rows_over_scenes, scene_name, scenes_of


def success(rows: Sequence[ResultRow], palette: FigurePalette) -> Figure:
    """Draw the success of each method in each scene, before (ring) and after fine-tuning (disc), with intervals."""
    rows = [*rows_over_scenes(rows), *rows]
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    axes = figure.subplots()
    columns = _Columns(rows, palette)
    for row in rows:
        x = columns.place(row)
        colour = columns.colour(row)
        fill = columns.fill(row)
        axes.plot([x, x], [row.success.low, row.success.high], color=colour, linewidth=2.4, alpha=0.55, zorder=2)
        axes.plot(x, row.success.mean, "o", color=colour, markerfacecolor=fill, markersize=7.5, zorder=3)
    columns.finish(axes)
    in_percent(axes, ylim=(0, 1.02), ylabel="goals reached")
    _legend(figure, columns)
    return figure


def size_figure(rows: Sequence[ResultRow], palette: FigurePalette) -> Figure:
    """Draw nodes and edges of each method's maps, the mean of the seeds and from the smallest to the largest."""
    figure = Figure(figsize=(WIDTH_IN, 5.6), layout="constrained")
    columns = _Columns(rows, palette)
    for axes, what in zip(figure.subplots(2, 1, sharex=True), ("nodes", "edges"), strict=True):
        for row in rows:
            counts = [getattr(trial.map, what) for trial in row.trials]
            x = columns.place(row)
            colour = columns.colour(row)
            fill = columns.fill(row)
            axes.plot([x, x], [min(counts), max(counts)], color=colour, linewidth=2.4, alpha=0.55, zorder=2)
            axes.plot(x, np.mean(counts), "o", color=colour, markerfacecolor=fill, markersize=7.5, zorder=3)
        axes.set(yscale="log", ylabel=what)
        axes.margins(y=0.15)
        in_counts(axes)
        columns.finish(axes)
    _legend(figure, columns)
    return figure


def cause_figure(rows: Sequence[ResultRow], palette: FigurePalette) -> Figure:
    """Draw for each row the share of failed episodes by cause."""
    names = [f"{row.setup.method}\n{row.setup.stage}" for row in rows]
    figure = Figure(figsize=(WIDTH_IN, 1.3 + 0.48 * len(rows)), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(rows))
    for cause in FailureCause:
        share = np.array([row.failed(cause) for row in rows])
        if not share.any():
            continue
        axes.barh(names, share, left=left, height=0.62, color=cause_colour(cause), label=cause.value)
        left += share
    for y, total in enumerate(left):
        axes.annotate(
            f"{100 * total:.1f} %", (total, y), (6, 0), textcoords="offset points", va="center", color=palette.text
        )
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.set(xlim=(0, min(1.0, max(left, default=0.0) * 1.1 + 0.02)), xlabel="episodes that failed")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


class _Columns:
    """Positions of the rows: a group per scene with a column per method, before and after fine-tuning side by side."""

    def __init__(self, rows: Sequence[ResultRow], palette: FigurePalette) -> None:
        self.methods = methods_of(rows)
        self.scenes = tuple(sorted(scenes_of(rows), key=lambda scene: scene != ALL_SCENES))
        self.both = len({row.setup.finetuned for row in rows}) > 1
        self._colours = method_colours(self.methods, palette)
        self.palette = palette

    def place(self, row: ResultRow) -> float:
        number = self.methods.index(row.setup.method)
        count = len(self.methods)
        step = 0.78 / count
        beside = (0.22 if row.setup.finetuned else -0.22) * step if self.both else 0.0
        return self.scenes.index(row.setup.scene) + (number - (count - 1) / 2) * step + beside

    def colour(self, row: ResultRow) -> Colour:
        return self._colours[row.setup.method]

    def fill(self, row: ResultRow) -> Colour | str:
        return self._colours[row.setup.method] if row.setup.finetuned else "none"

    def finish(self, axes: Axes) -> None:
        axes.set_xticks(range(len(self.scenes)), [scene_name(scene) for scene in self.scenes])
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        axes.set_xlim(-0.5, len(self.scenes) - 0.5)
        for border in range(1, len(self.scenes)):
            axes.axvline(border - 0.5, color=self.palette.grey, linewidth=0.6, alpha=0.5)

    def handles(self) -> list[Line2D]:
        """Return the entries of the legend."""
        named = [_dot(colour, label=method) for method, colour in self._colours.items()]
        if not self.both:
            return named
        grey = self.palette.grey
        rings = _dot(grey, markerfacecolor="none", label="as trained")
        return [*named, rings, _dot(grey, label="fine-tuned")]


def _dot(colour: Colour, **more: Any) -> Line2D:
    return Line2D([], [], color=colour, linestyle="", marker="o", **more)


def _legend(figure: Figure, columns: _Columns) -> None:
    handles = columns.handles()
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 4 if len(handles) > 6 else 6))
