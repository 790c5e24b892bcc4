"""Metrics in bins: calibration of r, and position error against another quantity. Numpy only."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ltvn_core.network.metrics.reachability_metrics import quantile, share


@dataclass(frozen=True, slots=True)
class CalibrationBin:
    """Pairs whose predicted r lies in [low, high), or [low, high] in the last bin."""

    low: float
    high: float
    pairs: int
    predicted: float | None
    """Mean r; None if the bin is empty."""
    reachable: float | None
    """Share that is truly reachable; None if the bin is empty."""


@dataclass(frozen=True, slots=True)
class ErrorBin:
    """Reachable pairs for which some quantity lies in [low, high), or [low, high] in the last bin."""

    low: float
    high: float
    pairs: int
    position_median_m: float | None
    """Median position error; None if the bin is empty."""
    position_p90_m: float | None
    """90th percentile of the position error; None if the bin is empty."""


def calibration_table(
    reachability: NDArray[np.float64], reachable: NDArray[np.bool_], bins: int = 10
) -> tuple[CalibrationBin, ...]:
    """Return the calibration of predictions (N,) in [0, 1] against truth (N,) in bins of equal width."""
    edges = np.linspace(0, 1, bins + 1).tolist()
    rows = [(low, high, reachability[inside], reachable[inside]) for low, high, inside in _inside(edges, reachability)]
    return tuple(
        CalibrationBin(low=low, high=high, pairs=len(r), predicted=_mean(r), reachable=or_none(share(truth)))
        for low, high, r, truth in rows
    )


def error_table(
    edges: Sequence[float], quantity: NDArray[np.float64], error_m: NDArray[np.float64]
) -> tuple[ErrorBin, ...]:
    """Return position errors (N,) in bins of a quantity (N,) between `edges`; values outside are left out."""
    return tuple(
        ErrorBin(
            low=low,
            high=high,
            pairs=int(inside.sum()),
            position_median_m=or_none(quantile(error_m[inside], 0.5)),
            position_p90_m=or_none(quantile(error_m[inside], 0.9)),
        )
        for low, high, inside in _inside(edges, quantity)
    )


def _inside(edges: Sequence[float], quantity: NDArray[np.float64]) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Return the borders of each bin and the mask (N,) of the values in it."""
    last = edges[-1]
    return [
        (low, high, (quantity >= low) & ((quantity < high) | ((quantity == last) & (high == last))))
        for low, high in pairwise(edges)
    ]


def or_none(number: float) -> float | None:
    """Return a number, None for NaN: JSON has none."""
    return None if np.isnan(number) else number


def _mean(numbers: NDArray[np.float64]) -> float | None:
    return float(numbers.mean()) if len(numbers) else None
