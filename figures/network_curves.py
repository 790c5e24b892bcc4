"""The curves: calibration of r, errors against distance and overlap, near against far pairs of drives.

Owns their binning and drawing. The numbers written into them come from
`ltvn_core.network.metrics`.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from figures.network_predictions import DrivePredictions, PairPredictions
from ltvn_core.evaluation.reports.figure_style import Colour, FigurePalette
from ltvn_core.network.metrics import calibration_error, drive_metrics

MIN_PAIRS_PER_BIN = 8
"""Bins with fewer pairs than this say nothing and are left out."""


class ReliabilityBins(NamedTuple):
    """Bins of the predicted probability, empty ones left out."""

    predicted: NDArray[np.float64]
    """(B,) mean r in the bin,"""
    true: NDArray[np.float64]
    """(B,) share of reachable pairs in it,"""
    pairs: NDArray[np.intp]
    """(B,) and how many pairs there are."""


def reliability_bins(probability: NDArray[np.float64], positive: NDArray[np.bool_], bins: int = 10) -> ReliabilityBins:
    """Return the bins over which the expected calibration error is taken."""
    index = np.minimum((probability * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    full = count > 0
    sums = [np.bincount(index, numbers, minlength=bins)[full] / count[full] for numbers in (probability, positive)]
    return ReliabilityBins(sums[0], sums[1], count[full])


class ErrorBand(NamedTuple):
    """An error over bins: its median, and between which values 90 % of it lie."""

    middle: NDArray[np.float64]
    median: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def error_band(at: NDArray[np.float64], error: NDArray[np.float64], borders: NDArray[np.float64]) -> ErrorBand:
    """Return quantiles of an error (N,) over bins of `at` (N,), bins of few pairs left out."""
    rows = []
    for low, high in pairwise(borders):
        inside = error[(at >= low) & (at < high)]
        if len(inside) >= MIN_PAIRS_PER_BIN:
            rows.append([(low + high) / 2, *np.quantile(inside, [0.5, 0.05, 0.95])])
    return ErrorBand(*np.array(rows).reshape(-1, 4).T)


def calibration_figure(found: PairPredictions, palette: FigurePalette) -> Figure:
    """Draw the reliability diagram of r, with the number of pairs in each bin."""
    figure = Figure(figsize=(5.2, 5.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    bins = reliability_bins(found.reachability, found.reachable)
    above.plot([0, 1], [0, 1], "--", color=palette.grey, linewidth=1.2, label="perfect")
    above.plot(bins.predicted, bins.true, "o-", color=palette.first, label="measured")
    error = calibration_error(found.reachability, found.reachable)
    above.set(ylabel="share truly reachable", ylim=(-0.02, 1.02), title=f"Mean gap (ECE) {error:.3f}")
    edges = np.linspace(0, 1, 11)
    both = [found.reachability[found.reachable], found.reachability[~found.reachable]]
    below.hist(both, edges, color=[palette.first, palette.second], label=["reachable", "not reachable"])
    below.set(yscale="log", xlabel="r, as the network says", ylabel="pairs", xlim=(0, 1), ylim=(1, None))
    below.yaxis.set_major_locator(LogLocator(numticks=4))
    below.yaxis.set_minor_formatter(NullFormatter())
    above.legend(handles=[*above.get_lines(), *below.get_legend_handles_labels()[0]], loc="upper left")
    return figure


def pose_error_figure(found: PairPredictions, palette: FigurePalette) -> Figure:
    """Draw the position error of reachable pairs against distance and against overlap."""
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    chosen = found.reachable
    distance, overlap, off = (each[chosen] for each in (found.distance_m, found.overlap, found.position_error_m))
    farthest = float(distance.max(initial=1.0))
    _draw_band(left, error_band(distance, off, np.linspace(0, farthest, 11)), palette.first)
    least = float(np.nanmin(overlap, initial=0.9))
    _draw_band(right, error_band(overlap, off, np.linspace(np.floor(least * 10) / 10, 1.0001, 9)), palette.second)
    left.set(xlabel="distance (m)", ylabel="position error (m)", title="Against distance", xlim=(0, None))
    right.set(xlabel="overlap", title="Against overlap")
    left.set_ylim(0, None)
    left.legend(loc="upper left")
    return figure


def false_long_range_figure(found: DrivePredictions, palette: FigurePalette) -> Figure:
    """Draw the share of far pairs that pass a cut against the share of near pairs that do."""
    figure = Figure(figsize=(6.2, 4.4), layout="constrained")
    axes = figure.subplots()
    figures = drive_metrics(found.near, found.far)
    cuts = np.unique(np.quantile(found.near, np.linspace(0.0, 0.95, 400)))
    kept = np.array([(found.near >= cut).mean() for cut in cuts])
    far = np.sort(found.far)
    passed = (len(far) - np.searchsorted(far, cuts)) / max(len(far), 1)
    floor = 0.5 / max(len(far), 1)
    axes.step(kept, np.maximum(passed, floor), where="post", color=palette.first)
    axes.axhline(1e-4, color=palette.grey, linestyle="--", linewidth=1.2)
    axes.annotate("1 in 10,000", (0.02, 1.15e-4), color=palette.grey, xycoords=("axes fraction", "data"))
    axes.plot(0.6, max(figures.far_fpr_at_tpr60, floor), "o", color=palette.second, markersize=8, zorder=5)
    passing = f"{figures.far_fpr_at_tpr60:.1e}" if figures.far_fpr_at_tpr60 else "none"
    axes.annotate(
        f"{passing} at r ≥ {figures.threshold_at_tpr60:.2f}",
        (0.6, max(figures.far_fpr_at_tpr60, floor)),
        (-10, 12),
        ha="right",
        textcoords="offset points",
        color=palette.second,
        weight="bold",
    )
    axes.set(
        yscale="log",
        ylim=(floor / 2, 1),
        xlim=(0, 1),
        xlabel="share of near pairs that pass",
        ylabel="share of far pairs that pass",
        title=f"{figures.near_pairs:,} near and {figures.far_pairs:,} far pairs",
    )
    return figure


def _draw_band(axes: Axes, over: ErrorBand, colour: Colour) -> None:
    axes.fill_between(over.middle, over.low, over.high, color=colour, alpha=0.18, linewidth=0, label="90 % of pairs")
    axes.plot(over.middle, over.median, "o-", color=colour, label="median")
