"""Figures in bins: calibration of r, and error against whatever it may grow with. Pure numpy."""

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
    """Mean r; None of nothing."""
    reachable: float | None
    """Share that is truly reachable; None of nothing."""


@dataclass(frozen=True, slots=True)
class ErrorBin:
    """Reachable pairs for which some quantity lies in [low, high), or [low, high] in the last bin."""

    low: float
    high: float
    pairs: int
    position_median_m: float | None
    """None of nothing."""
    position_p90_m: float | None
    """None of nothing."""


def calibration_table(
    reachability: NDArray[np.float64], reachable: NDArray[np.bool_], bins: int = 10
) -> tuple[CalibrationBin, ...]:
    """Sort predictions (N,) in [0, 1] and truth (N,) into equal bins."""
    edges = np.linspace(0, 1, bins + 1).tolist()
    rows = [(low, high, reachability[inside], reachable[inside]) for low, high, inside in _inside(edges, reachability)]
    return tuple(
        CalibrationBin(low=low, high=high, pairs=len(r), predicted=_mean(r), reachable=_or_none(share(truth)))
        for low, high, r, truth in rows
    )


def error_table(
    edges: Sequence[float], quantity: NDArray[np.float64], error_m: NDArray[np.float64]
) -> tuple[ErrorBin, ...]:
    """Sort position errors (N,) into bins between `edges` of a quantity (N,); what lies outside is left out."""
    return tuple(
        ErrorBin(low, high, int(inside.sum()), *(_or_none(quantile(error_m[inside], part)) for part in (0.5, 0.9)))
        for low, high, inside in _inside(edges, quantity)
    )


def _inside(edges: Sequence[float], quantity: NDArray[np.float64]) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Return each bin with the mask (N,) of what lies in it."""
    last = edges[-1]
    return [
        (low, high, (quantity >= low) & ((quantity < high) | ((quantity == last) & (high == last))))
        for low, high in pairwise(edges)
    ]


def _or_none(number: float) -> float | None:
    return None if np.isnan(number) else number


def _mean(numbers: NDArray[np.float64]) -> float | None:
    return float(numbers.mean()) if len(numbers) else None
