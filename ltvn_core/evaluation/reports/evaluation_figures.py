"""The figures of an evaluation report, with their names, titles and captions.

Owns the drawing of two groups of figures. Those that compare methods show success, size of the graph and causes of
failure. Those of lifelong evaluations show success, map size and spurious edges over queries, and the calibration of p.
Figures of maps over the floor plan are in `map_figures`. The numbers come from result rows and lifelong groups.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.reports.figure_style import (
    WIDTH_IN,
    Colour,
    FigurePalette,
    ReportFigure,
    cause_colour,
    in_counts,
    in_percent,
    method_colours,
    slug,
)
from ltvn_core.evaluation.reports.map_figures import MapPanel, map_figure
from ltvn_core.evaluation.reports.result_rows import (
    ALL_SCENES,
    LifelongGroup,
    ResultRow,
    calibration_error,
    calibration_of,
    end_points,
    group_lifelong,
    grouped,
    maintenance_intervals,
    methods_of,
    rows_of,
    rows_over_scenes,
    scene_name,
    scenes_of,
)
from ltvn_core.evaluation.results import Run

_BAD: Colour = (0.78, 0.24, 0.32)
"""Colour of spurious edges."""


def lifelong_figure(group: LifelongGroup, palette: FigurePalette) -> Figure:
    """Draw a lifelong group: success with its interval, changes by maintenance, and nodes, edges and spurious edges."""
    figure = Figure(figsize=(WIDTH_IN, 5.4), layout="constrained")
    axes = figure.subplot_mosaic(
        [["success", "nodes"], ["success", "edges"], ["changes", "spurious"]], width_ratios=(1.25, 1), sharex=True
    )
    _success(axes["success"], group, palette)
    _changes(axes["changes"], group, palette)
    _followed(axes["nodes"], group, lambda query: query.nodes, palette.first)
    _followed(axes["edges"], group, lambda query: query.edges, palette.first)
    _followed(axes["spurious"], group, lambda query: query.spurious_edges, _BAD)
    for name in ("nodes", "edges"):
        axes[name].set_title(name)
    axes["spurious"].set_title("spurious edges")
    for name in ("changes", "spurious"):
        axes[name].set_xlabel("queries with maintenance")
    return figure


def edge_calibration_figure(lifelong_groups: Sequence[LifelongGroup], palette: FigurePalette) -> Figure:
    """Draw the share of drivable edges over p, at the first test and at the last."""
    figure = Figure(figsize=(5.6, 5.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], "--", color=palette.grey, linewidth=1.2, label="perfect")
    for last, words, colour in ((False, "before", palette.second), (True, "after", palette.first)):
        cells = calibration_of(end_points(lifelong_groups, last=last))
        label = f"{words} the queries, mean gap {calibration_error(cells):.3f}"
        above.plot([cell.mean_p for cell in cells], [cell.drivable for cell in cells], "o-", color=colour, label=label)
        share = -0.2 if not last else 0.2
        for cell in cells:
            width = cell.high - cell.low
            below.bar((cell.low + cell.high) / 2 + share * width, cell.edges, width=0.38 * width, color=colour)
    in_percent(above, ylim=(-0.02, 1.02), ylabel="edges that can be driven")
    below.set(yscale="log", xlabel="p of the edge", ylabel="edges", xlim=(-0.02, 1.02))
    in_counts(below)
    above.legend(loc="best")
    return figure


def _success(axes: Axes, group: LifelongGroup, palette: FigurePalette) -> None:
    points = group.points()
    at = [row.setup.queries for row in points]
    axes.fill_between(
        at,
        [row.success.low for row in points],
        [row.success.high for row in points],
        color=palette.first,
        alpha=0.2,
        linewidth=0,
    )
    for run in group.runs if len(group.runs) > 1 else ():
        reached = [np.mean([episode.reached for episode in point.episodes]) for point in run.maps]
        axes.plot([point.after for point in run.maps], reached, color=palette.grey, linewidth=0.9, alpha=0.7)
    axes.plot(at, [row.success.mean for row in points], "o-", color=palette.first, markersize=5)
    lowest = min((row.success.low for row in points), default=0.0)
    in_percent(axes, ylim=(max(0.0, np.floor(lowest * 10 - 1) / 10), 1.01))
    axes.set_title("goals reached")


def _changes(axes: Axes, group: LifelongGroup, palette: FigurePalette) -> None:
    """Draw bars of added edges upwards and of pruned edges downwards; the harmful part of each is darker."""
    for interval in maintenance_intervals(group):
        middle = (interval.first + interval.until) / 2
        width = 0.72 * (interval.until - interval.first)
        axes.bar(middle, interval.added_edges, width=width, color=palette.first, alpha=0.75)
        axes.bar(middle, interval.added_spurious, width=width, color=_BAD)
        axes.bar(middle, -interval.pruned, width=width, color=palette.second, alpha=0.75)
        axes.bar(middle, -interval.pruned_bad, width=width, color=_BAD)
    axes.axhline(0, color=palette.grey, linewidth=1)
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True, symmetric=True))
    axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):.0f}")
    axes.set_title("edges added ▲ and pruned ▼ between tests")


def _followed(axes: Axes, group: LifelongGroup, count: Callable[[QueryResult], int], colour: Colour) -> None:
    """Draw a count after every query, a line for each run."""
    for run in group.runs:
        axes.plot(
            [query.query for query in run.queries], [count(query) for query in run.queries], color=colour, linewidth=1.3
        )
    axes.set_ylim(0, max(1.0, 1.15 * axes.get_ylim()[1]))


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
    """Draw the nodes and edges of each method's maps: the mean over seeds, and the range from smallest to largest."""
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


def figures_of(runs: Sequence[Run], palette: FigurePalette) -> tuple[ReportFigure, ...]:
    """Return all figures for which there are results, not yet drawn."""
    rows = rows_of(runs)
    groups = group_lifelong(runs)
    return (*_row_figures(rows, palette), *_map_figures(rows, palette), *_lifelong_figures(groups, palette))


def _row_figures(rows: Sequence[ResultRow], palette: FigurePalette) -> Iterator[ReportFigure]:
    whole = [row for row in rows if not row.setup.ablated and not row.setup.queries]
    ablated = {row.setup.scene for row in rows if row.setup.ablated}
    parts = [row for row in rows if not row.setup.queries and row.setup.scene in ablated]
    if whole:
        caption = "Goals reached, with 95 % intervals."
        if len({row.setup.finetuned for row in whole}) > 1:
            caption += " Rings: network as trained. Discs: after fine-tuning on the drive."
        title = "Success per scene and method"
        yield ReportFigure("success", "success", title, caption, partial(success, whole, palette))
        caption = "Nodes and edges of the maps: mean of the map seeds, and from the smallest to the largest."
        title = "Nodes and edges per scene and method"
        yield ReportFigure("sizes", "sizes", title, caption, partial(size_figure, whole, palette))
    if parts:
        caption = "Goals reached when single parts of the method are switched off, with 95 % intervals."
        yield ReportFigure("success", "ablation", "Effect of each part", caption, partial(success, parts, palette))
    if whole:
        over = rows_over_scenes(whole) or whole
        caption = "Share of the episodes that failed, by the main cause of each failure."
        title = "Causes of failure over all scenes"
        yield ReportFigure("causes", "causes", title, caption, partial(cause_figure, over, palette))


def _map_figures(rows: Sequence[ResultRow], palette: FigurePalette) -> Iterator[ReportFigure]:
    """Draw the maps of each scene's first seed."""
    drawn = [row for row in rows if row.trials[0].floorplan is not None and not row.setup.ablated]
    for scene, here in grouped(drawn, lambda row: row.setup.scene).items():
        panels = [MapPanel(f"{row.setup.method}, {row.setup.stage}", row.trials[0]) for row in here]
        seed = panels[0].trial.columns.seed
        caption = f"Map seed {seed}. Grey: too narrow for the robot. Red crosses: spurious edges."
        name, title = f"floors-{slug(scene_name(scene))}", f"Maps of {scene_name(scene)}"
        yield ReportFigure("floors", name, title, caption, partial(map_figure, panels, palette))


def _lifelong_figures(groups: Sequence[LifelongGroup], palette: FigurePalette) -> Iterator[ReportFigure]:
    for group in groups:
        scene = scene_name(group.scene)
        name = f"{slug(scene)}-{slug(group.method)}"
        several = len(group.runs) > 1
        caption = (
            f"Goals reached with maintenance off, with 95 % interval{'; thin lines are single maps' * several}. "
            f"Below: edges added and pruned{', means of the runs' * several}; red are the spurious ones."
        )
        title = f"{group.method} in {scene}"
        draw = partial(lifelong_figure, group, palette)
        yield ReportFigure("lifelong", f"lifelong-{name}", title, caption, draw)
        first, last = group.runs[0].maps[0], group.runs[0].maps[-1]
        if first is not last and first.floorplan is not None and last.floorplan is not None:
            panels = [MapPanel(f"after {point.after:,} queries", point) for point in (first, last)]
            caption = f"Map seed {first.columns.seed}, before and after maintenance. Red crosses: spurious edges."
            draw = partial(map_figure, panels, palette)
            yield ReportFigure("lifelong", f"map-{name}", f"The map of {scene} before and after", caption, draw)
    if any(point.calibration for group in groups for run in group.runs for point in run.maps):
        caption = "On the dashed line, p equals the share of edges that can be driven."
        draw = partial(edge_calibration_figure, groups, palette)
        yield ReportFigure("calibration", "calibration", "Can p be believed?", caption, draw)
