"""Galleries of labelled pairs: reachable ones over distance, and one row for each criterion that others fail.

Owns which pairs are shown and how. They are drawn at random from the shards, with a fixed seed.
"""

import textwrap
from collections.abc import Sequence
from math import degrees
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from figures.pair_table import (
    LabelledPair,
    PairTable,
    criterion_name,
    limits_from_recipe,
    reasons,
    single_criteria,
    waypoint_outline,
)
from ltvn_core.evaluation.reports.figure_style import Colour, FigurePalette
from ltvn_core.network.training_data.reachability_labels import FailedCriteria, ReachabilityLimits
from ltvn_core.network.training_data.shards import Shard

DISTANCES_M = (0.4, 0.9, 1.4, 2.0)
"""Reachable pairs about so far apart are shown."""

ROW_HEIGHT_IN = 1.62
"""Height of a row."""


_LINE_CHARACTERS = 38
"""Letters in a line of text beside a pair."""


class PairRow(NamedTuple):
    """A pair and what is written beside it."""

    pair: LabelledPair
    title: str
    text: str


def reachable_rows(shards: Sequence[Shard], rng: np.random.Generator) -> list[PairRow]:
    """Return reachable pairs near each of `DISTANCES_M`."""
    rows = []
    for wish in DISTANCES_M:
        table = PairTable(shards[int(rng.integers(len(shards)))])
        apart = np.where(table.shard.reachable, np.abs(table.distance_m - wish), np.inf)
        good = np.flatnonzero(apart <= max(0.1, float(apart.min(initial=np.inf))))
        if len(good) and np.isfinite(apart[good]).all():
            pair = table.pair(int(rng.choice(good)))
            rows.append(PairRow(pair, f"{pair.distance_m:.1f} m", _numbers(pair)))
    return rows


def unreachable_rows(shards: Sequence[Shard], rng: np.random.Generator) -> list[PairRow]:
    """Return a pair for each criterion: one that fails it alone where there is one."""
    rows = []
    for criterion in single_criteria():
        if (pair := _failing(shards, criterion, rng)) is not None:
            rows.append(
                PairRow(pair, criterion_name(criterion), _why(pair, criterion, limits_from_recipe(shards[0].recipe)))
            )
    return rows


def pair_gallery(rows: Sequence[PairRow], palette: FigurePalette) -> Figure:
    """Draw pairs: source, target, text. The ring in the source is the target's true place."""
    figure = Figure(figsize=(8.4, ROW_HEIGHT_IN * max(len(rows), 1) + 0.3), layout="constrained")
    grid = figure.subplots(max(len(rows), 1), 3, squeeze=False, width_ratios=(1, 1, 1.75))
    for (left, right, words), row in zip(grid, rows, strict=False):
        _draw_image(left, row.pair.source_rgb, palette.first)
        _draw_image(right, row.pair.target_rgb, palette.second)
        for line in waypoint_outline(row.pair.waypoint):
            left.plot(*line.T - 0.5, color="black", linewidth=4, solid_capstyle="round", alpha=0.7)
        for line in waypoint_outline(row.pair.waypoint):
            left.plot(*line.T - 0.5, color=palette.second, linewidth=2, solid_capstyle="round")
        words.axis("off")
        words.text(0.03, 0.72, row.title, weight="bold", fontsize=12, va="center", transform=words.transAxes)
        words.text(0.03, 0.58, row.text, va="top", linespacing=1.45, transform=words.transAxes)
    grid[0][0].set_title("Source", color=palette.first)
    grid[0][1].set_title("Target", color=palette.second)
    return figure


def _failing(shards: Sequence[Shard], criterion: FailedCriteria, rng: np.random.Generator) -> LabelledPair | None:
    """Return a pair that fails the criterion: rather alone, and rather with its place in the picture."""
    tables = [PairTable(shard) for shard in shards]
    for only, ahead in ((True, True), (False, True), (False, False)):
        found = [(table, int(row)) for table in tables for row in _rows(table, criterion, only=only, ahead=ahead)]
        if found:
            table, row = found[int(rng.integers(len(found)))]
            return table.pair(row)
    return None


def _rows(table: PairTable, criterion: FailedCriteria, *, only: bool, ahead: bool) -> NDArray[np.intp]:
    failed, (forward, left, _) = table.shard.failed, table.waypoints.T
    chosen = failed == int(criterion) if only else (failed & int(criterion)) != 0
    if ahead:
        chosen &= (forward > 0.5) & (np.abs(left) < 0.6 * forward)
    return np.flatnonzero(chosen)


def _why(pair: LabelledPair, criterion: FailedCriteria, limits: ReachabilityLimits) -> str:
    found = reasons(pair, limits)
    text = next(each.text for each in found if each.criterion == criterion)
    lines = textwrap.wrap(f"{text[0].upper()}{text[1:]}.", _LINE_CHARACTERS)
    others = ", ".join(each.name for each in found if each.criterion != criterion)
    return "\n".join([*lines, f"(Fails {others} too.)"] if others else lines)


def _numbers(pair: LabelledPair) -> str:
    return (
        f"turned by {abs(degrees(pair.waypoint[2])):.0f}°\n"
        f"the source sees {pair.overlap:.0%} of the target's points\n"
        f"the way is {pair.path_ratio:.2f} times the straight line"
    )


def _draw_image(axes: Axes, rgb: NDArray[np.uint8], colour: Colour) -> None:
    height, width = rgb.shape[:2]
    # Plain pixels show what the network gets, and they pack well.
    axes.imshow(rgb, interpolation="nearest")
    axes.set(xticks=[], yticks=[], xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    for spine in axes.spines.values():
        spine.set(visible=True, edgecolor=colour, linewidth=2.5)
