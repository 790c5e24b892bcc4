"""Figures of lifelong evaluations: success, map size and spurious edges over queries, and calibration of p.

Owns their drawing. The numbers come in courses.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.results import EdgeCalibrationBin
from ltvn_core.reports.evaluation_style import WIDTH_IN, in_counts, in_percent
from ltvn_core.reports.figure_style import Colour, FigurePalette
from ltvn_core.reports.lifelong_groups import (
    LifelongGroup,
    calibration_error,
    calibration_of,
    end_points,
    maintenance_intervals,
)

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
        _reliability(above, cells, f"{words} the queries, mean gap {calibration_error(cells):.3f}", colour)
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
        reached = [np.mean([episode.reached for episode in point.trial.episodes]) for point in run.points]
        axes.plot([point.queries for point in run.points], reached, color=palette.grey, linewidth=0.9, alpha=0.7)
    axes.plot(at, [row.success.mean for row in points], "o-", color=palette.first, markersize=5)
    lowest = min((row.success.low for row in points), default=0.0)
    in_percent(axes, ylim=(max(0.0, np.floor(lowest * 10 - 1) / 10), 1.01))
    axes.set_title("goals reached")


def _changes(axes: Axes, group: LifelongGroup, palette: FigurePalette) -> None:
    """Draw bars of added edges upwards and of pruned ones downwards, the bad part of either darker."""
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


def _reliability(axes: Axes, cells: Sequence[EdgeCalibrationBin], label: str, colour: Colour) -> None:
    axes.plot([cell.mean_p for cell in cells], [cell.drivable for cell in cells], "o-", color=colour, label=label)
