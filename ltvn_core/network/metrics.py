"""Metrics of predictions: pairs, drives, bins of calibration and error, and success rates. No torch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import distance, wrap_angle
from ltvn_core.types import Waypoint


@dataclass(frozen=True, slots=True)
class PairMetrics:
    """Metrics on labelled pairs."""

    pairs: int
    """Labelled pairs."""
    auc: float
    """Area under the ROC curve."""
    ece: float
    """Expected calibration error of reachability, in ten bins."""
    position_median_m: float
    """Median position error of reachable pairs."""
    position_p90_m: float
    """90th percentile of the position error of reachable pairs."""
    position_median_1_to_1_5_m: float
    """Median position error of reachable pairs 1 to 1.5 m apart."""
    yaw_median_deg: float
    """Median yaw error of reachable pairs."""
    yaw_p90_deg: float
    """90th percentile of the yaw error of reachable pairs."""
    distance_sigma: float
    """Standard deviation of d(predicted) - d(true) on reachable pairs."""


@dataclass(frozen=True, slots=True)
class DriveMetrics:
    """Metrics on all ordered image pairs of drives."""

    far_pairs: int
    """Number of pairs that are far apart, turned away or behind a wall."""
    near_pairs: int
    """Number of pairs whose target is near, ahead and on a free straight line."""
    threshold_at_tpr60: float
    """Threshold of r that 60 % of the near pairs exceed."""
    far_fpr_at_tpr60: float
    """Share of the far pairs that exceed `threshold_at_tpr60`: the rate of false long-range edges."""
    far_fpr_at_half: float
    """Share of the far pairs with r above 0.5."""
    near_tpr_at_half: float
    """Share of the near pairs with r above 0.5."""


def pair_metrics(
    reachability: NDArray[np.float64],
    waypoints: Waypoint,
    reachable: NDArray[np.bool_],
    true_waypoints: Waypoint,
) -> PairMetrics:
    """Return the metrics of reachabilities (N,) and waypoints (N, 3) on labelled pairs."""
    off = waypoints[reachable]
    true = true_waypoints[reachable]
    position = np.hypot(*(off - true)[:, :2].T)
    yaw = np.degrees(np.abs(wrap_angle(off[:, 2] - true[:, 2])))
    middle = (np.hypot(*true[:, :2].T) >= 1.0) & (np.hypot(*true[:, :2].T) <= 1.5)
    return PairMetrics(
        pairs=len(reachable),
        auc=auc(reachability, reachable),
        ece=calibration_error(reachability, reachable),
        position_median_m=quantile(position, 0.5),
        position_p90_m=quantile(position, 0.9),
        position_median_1_to_1_5_m=quantile(position[middle], 0.5),
        yaw_median_deg=quantile(yaw, 0.5),
        yaw_p90_deg=quantile(yaw, 0.9),
        distance_sigma=float((distance(off) - distance(true)).std()) if len(off) else float("nan"),
    )


def drive_metrics(near: NDArray[np.float64], far: NDArray[np.float64]) -> DriveMetrics:
    """Return the metrics of the reachabilities of near and of far pairs."""
    threshold = quantile(near, 0.4)
    return DriveMetrics(
        far_pairs=len(far),
        near_pairs=len(near),
        threshold_at_tpr60=threshold,
        far_fpr_at_tpr60=share(far >= threshold),
        far_fpr_at_half=share(far > 0.5),
        near_tpr_at_half=share(near > 0.5),
    )


def auc(scores: NDArray[np.float64], positive: NDArray[np.bool_]) -> float:
    """Return the probability that a positive scores above a negative; nan if one kind is missing."""
    positives = int(positive.sum())
    negatives = int((~positive).sum())
    if positives == 0 or negatives == 0 or np.isnan(scores).any():
        return float("nan")
    others = np.sort(scores[~positive])
    # Twice the number of pairs in the right order, where a tie counts half.
    ordered = sum(np.searchsorted(others, scores[positive], side=side).sum() for side in ("left", "right"))
    return float(ordered / (2 * positives * negatives))


def calibration_error(probability: NDArray[np.float64], positive: NDArray[np.bool_]) -> float:
    """Return the mean gap between predicted and true share over ten bins of the prediction, weighted by their size."""
    bins = 10
    index = np.minimum((probability * bins).astype(int), bins - 1)
    gaps = np.bincount(index, probability - positive, minlength=bins)
    return float(np.abs(gaps).sum() / max(len(probability), 1))


def share(chosen: NDArray[np.bool_]) -> float:
    """Return the share of true values, nan for an empty array."""
    return float(chosen.mean()) if len(chosen) else float("nan")


def quantile(numbers: NDArray[np.float64], part: float) -> float:
    """Return a quantile, nan for an empty array."""
    return float(np.quantile(numbers, part)) if len(numbers) else float("nan")


@dataclass(frozen=True, slots=True)
class CalibrationBin:
    """Pairs whose predicted r lies in [low, high), or [low, high] in the last bin."""

    low: float
    high: float
    pairs: int
    predicted: float | None
    """Mean r; None if the bin is empty."""
    reachable: float | None
    """Share of the pairs that are reachable by ground truth; None if the bin is empty."""


@dataclass(frozen=True, slots=True)
class ErrorBin:
    """Reachable pairs with a quantity in [low, high), or in [low, high] in the last bin."""

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
    rows = [(low, high, reachability[inside], reachable[inside]) for low, high, inside in in_bins(edges, reachability)]
    return tuple(
        CalibrationBin(
            low=low,
            high=high,
            pairs=len(r),
            predicted=float(r.mean()) if len(r) else None,
            reachable=or_none(share(truth)),
        )
        for low, high, r, truth in rows
    )


def in_bins(edges: Sequence[float], quantity: NDArray[np.float64]) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Return the borders of each bin and the mask (N,) of the values in it."""
    last = edges[-1]
    return [
        (low, high, (quantity >= low) & ((quantity < high) | ((quantity == last) & (high == last))))
        for low, high in pairwise(edges)
    ]


def or_none(number: float) -> float | None:
    """Return a number, None for NaN: JSON has none."""
    return None if np.isnan(number) else number


@dataclass(frozen=True, slots=True)
class SuccessRate:
    """Successes in independent trials, with Wilson's 95 % interval."""

    successes: int
    trials: int
    share: float
    """Successes divided by trials; 0.5 without trials."""
    low: float
    """Lower end of the interval; 0 without trials."""
    high: float
    """Upper end of the interval; 1 without trials."""

    @classmethod
    def of(cls, successes: int, trials: int) -> "SuccessRate":
        """Count `successes` in `trials`; raise ValueError unless 0 <= successes <= trials."""
        if not 0 <= successes <= trials:
            raise ValueError(f"Successes lie between 0 and the {trials} trials, got {successes}.")
        if trials == 0:
            return cls(0, 0, 0.5, 0.0, 1.0)
        rate, z = successes / trials, NormalDist().inv_cdf(0.975)
        middle = (successes + z**2 / 2) / (trials + z**2)
        half = z / (trials + z**2) * math.sqrt(trials * rate * (1 - rate) + z**2 / 4)
        low = 0.0 if successes == 0 else middle - half
        return cls(successes, trials, rate, low, 1.0 if successes == trials else middle + half)

    @property
    def shrunk(self) -> float:
        """Return Laplace's estimate (k + 1) / (n + 2), which is never 0 or 1, so that no belief becomes certain."""
        return (self.successes + 1) / (self.trials + 2)
