"""The accuracy of a predictor on near and far pairs: its discrimination, and the errors of its waypoints.

All pairs are used if they are few; otherwise they are drawn evenly over sources and distances. A pair is accepted if
the method would join its images by an edge: r > R_c and d < D_c. AUC, calibration and recall at a false-positive rate
use a score: r if d < D_c, and 0 otherwise, because a far target may still be reachable. The same figures for r alone
are also given.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from ltvn_core.config import BuildingConfig
from ltvn_core.evaluation.confidence_intervals import Estimate, SampleGroup, estimates
from ltvn_core.geometry import distance, relative, wrap_angle
from ltvn_core.network.metrics import CalibrationBin, auc, calibration_error, calibration_table, or_none, quantile
from ltvn_core.training.drive_path import LIMITS, TrueViews
from ltvn_core.types import Features, Predictor, Waypoint

_MOST_SOURCES = 2000
"""Maximum number of source images, because the number of pairs grows with its square."""
_ROWS_AT_ONCE = 64


class PairCounts(NamedTuple):
    """Numbers of near and far pairs."""

    near: int
    far: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairSample:
    """P near and far pairs, grouped by source."""

    sources: NDArray[np.intp]
    """(P,) rows of the source images."""
    targets: NDArray[np.intp]
    """(P,) rows of the target images."""
    is_near: NDArray[np.bool_]
    """(P,) whether a pair is near; the others are far."""
    waypoints: Waypoint
    """(P, 3) true waypoints."""
    near_pairs: int
    """Number of near pairs."""
    far_pairs: int
    """Number of far pairs."""


def sample_pairs(sources: TrueViews, targets: TrueViews, *, most: PairCounts, rng: np.random.Generator) -> PairSample:
    """Return at most `most` near and far pairs of S sources and T targets, near and far by their true poses.

    Pairs are taken at even steps from the list of all pairs, ordered by source and then by distance, so that every
    source and every distance is represented. An image is never paired with itself, because it is not in front of
    itself.
    """
    looking = _evenly(len(sources), _MOST_SOURCES)
    counts = np.array([[part.sum() for part in kinds] for _, _, kinds in _rows(sources, targets, looking)]).reshape(
        -1, 2
    )
    picks = [choose_evenly(np.arange(total), count, rng) for total, count in zip(counts.sum(0), most, strict=True)]
    starts = np.cumsum(counts, axis=0) - counts
    parts: list[tuple[NDArray, ...]] = []
    for k, (source, waypoints, kinds) in enumerate(_rows(sources, targets, looking)):
        for kind, (mask, picked) in enumerate(zip(kinds, picks, strict=True)):
            first = starts[k, kind]
            inside = picked[np.searchsorted(picked, first) : np.searchsorted(picked, first + counts[k, kind])] - first
            rows = np.flatnonzero(mask)
            rows = rows[np.argsort(np.hypot(*waypoints[rows, :2].T), kind="stable")][inside]
            parts.append((np.full(len(rows), source), rows, np.full(len(rows), kind == 0), waypoints[rows]))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return PairSample(
        sources=columns[0].astype(np.intp),
        targets=columns[1].astype(np.intp),
        is_near=columns[2].astype(bool),
        waypoints=columns[3],
        near_pairs=int(counts[:, 0].sum()),
        far_pairs=int(counts[:, 1].sum()),
    )


def _rows(
    sources: TrueViews, targets: TrueViews, looking: NDArray[np.intp]
) -> Iterator[tuple[int, Waypoint, tuple[NDArray[np.bool_], NDArray[np.bool_]]]]:
    """Yield each source in `looking`, its waypoints to all targets (T, 3), and which targets are near and far (T,)."""
    for first in range(0, len(looking), _ROWS_AT_ONCE):
        chunk = looking[first : first + _ROWS_AT_ONCE]
        moves = sources.take(chunk).moves_to(targets)
        near = LIMITS.near(moves)
        far = LIMITS.far(moves)
        waypoints = relative(sources.poses[chunk][:, None], targets.poses[None])
        yield from ((int(row), waypoints[k], (near[k], far[k])) for k, row in enumerate(chunk))


def choose_evenly(rows: NDArray[np.intp], most: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return at most `most` of the rows, at even steps with a random offset."""
    if len(rows) <= most:
        return rows
    return rows[((np.arange(most) + rng.random()) * len(rows) / most).astype(np.intp)]


def _evenly(count: int, most: int) -> NDArray[np.intp]:
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)


_NEAR_AT_ONCE = 64
_STRETCHES = 10
"""Number of blocks of consecutive sources that a share's interval is computed from, because neighbouring images are
nearly equal and thus not independent."""
_DISTANCES_M = (0.0, 0.1, 0.3, 0.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceBin:
    """Near pairs whose distance lies between two limits, in metres."""

    low_m: float
    high_m: float
    pairs: int
    recall: float | None
    """Share of accepted pairs; None without pairs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairAccuracy:
    """Figures of one predictor on near and far pairs; None without such pairs."""

    near_pairs: int
    """Number of near pairs in the recording."""
    near_compared: int
    """Number of near pairs that were compared."""
    far_pairs: int
    far_compared: int
    auc: float | None
    near_recall: float | None
    """Share of accepted near pairs."""
    near_recall_low: float | None
    """Lower end of the 95 % interval of `near_recall`."""
    near_recall_high: float | None
    far_fpr: float | None
    """Share of accepted far pairs."""
    far_fpr_low: float | None
    """Lower end of the 95 % interval of `far_fpr`."""
    far_fpr_high: float | None
    recall_at_far_fpr_1e3: float | None
    """Recall at the threshold that accepts at most one far pair in 1,000; None with fewer far pairs."""
    recall_at_far_fpr_1e4: float | None
    """Recall at the threshold that accepts at most one far pair in 10,000; None with fewer far pairs."""
    waypoint_median_m: float | None
    """Median position error of accepted near pairs, in metres."""
    waypoint_p90_m: float | None
    """90th percentile of the position error of accepted near pairs, in metres."""
    moved_median_m: float | None
    """Median position error of a predictor that always answers "no motion", in metres."""
    yaw_median_deg: float | None
    ece: float | None
    """Expected calibration error in ten bins, with equal weight of near and far pairs."""
    auc_of_r: float | None
    """AUC of r alone."""
    near_recall_of_r: float | None
    """Share of the near pairs with r > R_c."""
    far_fpr_of_r: float | None
    """Share of the far pairs with r > R_c."""
    near_by_distance: tuple[DistanceBin, ...]
    calibration: tuple[CalibrationBin, ...]
    """Bins of the calibration, over equal numbers of near and far pairs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairScores:
    """Predictions for a sample of pairs."""

    sample: PairSample
    reachability: NDArray[np.float64]
    """(P,) r."""
    waypoints: Waypoint
    """(P, 3) predicted waypoints."""
    score: NDArray[np.float64]
    """(P,) r, or 0 if the predicted target is too far away for an edge."""
    accepted: NDArray[np.bool_]
    """(P,) whether the method would join a pair."""

    @property
    def position_error_m(self) -> NDArray[np.float64]:
        """(P,) distance from the predicted to the true target."""
        return np.hypot(*(self.waypoints - self.sample.waypoints)[:, :2].T)

    @property
    def yaw_error_rad(self) -> NDArray[np.float64]:
        """(P,) absolute error of yaw, in radians."""
        return np.abs(wrap_angle(self.waypoints[:, 2] - self.sample.waypoints[:, 2]))


def score_pairs(
    predictor: Predictor,
    sources: Features,
    targets: Features,
    sample: PairSample,
    config: BuildingConfig,
    *,
    progress: Callable[[int], object],
) -> PairScores:
    """Predict each near pair separately, and each source with all its far targets at once.

    A predictor that compares one image with many may read only a few of them. A map never holds dozens of images of one
    place, so near pairs must not compete with each other, while far ones must compete as in a map.

    Args:
        predictor: The predictor that encoded the features.
        sources: (S, F), one row per source image.
        targets: (T, F), one row per target image.
        sample: The pairs.
        config: Thresholds of an edge.
        progress: Called with the number of newly compared pairs.
    """
    reachability = np.empty(len(sample.sources))
    waypoints = np.empty((len(sample.sources), 3))
    for rows in _questions(sample):
        asked = sample.sources[rows[:1] if not sample.is_near[rows[0]] else rows]
        reachability[rows], waypoints[rows] = predictor.predict(sources[asked], targets[sample.targets[rows]])
        progress(len(rows))
    score = np.where(distance(waypoints) < config.connect_distance, reachability, 0.0)
    return PairScores(
        sample=sample,
        reachability=reachability,
        waypoints=waypoints,
        score=score,
        accepted=score > config.connect_reachability,
    )


def pair_accuracy(scores: PairScores, config: BuildingConfig, rng: np.random.Generator) -> PairAccuracy:
    """Return the figures of predictions; `rng` draws the pairs that calibration leaves out."""
    near = scores.sample.is_near
    found = near & scores.accepted
    recall = _share(scores.accepted, near, scores.sample)
    false_positives = _share(scores.accepted, ~near, scores.sample)
    sure = scores.reachability > config.connect_reachability
    even = _as_many_of_both(near, rng)
    return PairAccuracy(
        near_pairs=scores.sample.near_pairs,
        near_compared=int(near.sum()),
        far_pairs=scores.sample.far_pairs,
        far_compared=int((~near).sum()),
        auc=or_none(auc(scores.score, near)),
        near_recall=recall and recall.mean,
        near_recall_low=recall and recall.low,
        near_recall_high=recall and recall.high,
        far_fpr=false_positives and false_positives.mean,
        far_fpr_low=false_positives and false_positives.low,
        far_fpr_high=false_positives and false_positives.high,
        recall_at_far_fpr_1e3=_recall_at(scores.score, near, 1e-3),
        recall_at_far_fpr_1e4=_recall_at(scores.score, near, 1e-4),
        waypoint_median_m=or_none(quantile(scores.position_error_m[found], 0.5)),
        waypoint_p90_m=or_none(quantile(scores.position_error_m[found], 0.9)),
        moved_median_m=or_none(quantile(np.hypot(*scores.sample.waypoints[found, :2].T), 0.5)),
        yaw_median_deg=or_none(float(np.degrees(quantile(scores.yaw_error_rad[found], 0.5)))),
        ece=calibration_error(scores.score[even], near[even]) if len(even) else None,
        auc_of_r=or_none(auc(scores.reachability, near)),
        near_recall_of_r=float(sure[near].mean()) if near.any() else None,
        far_fpr_of_r=float(sure[~near].mean()) if not near.all() else None,
        near_by_distance=_by_distance(scores),
        calibration=calibration_table(scores.score[even], near[even]),
    )


def _questions(sample: PairSample) -> Iterator[NDArray[np.intp]]:
    """Yield rows of pairs that are predicted together: some near pairs, or all far pairs of a source."""
    near = np.flatnonzero(sample.is_near)
    for first in range(0, len(near), _NEAR_AT_ONCE):
        yield near[first : first + _NEAR_AT_ONCE]
    far = np.flatnonzero(~sample.is_near)
    begins = np.flatnonzero(np.diff(sample.sources[far], prepend=-1))
    yield from (rows for rows in np.split(far, begins) if len(rows))


def _share(accepted: NDArray[np.bool_], kind: NDArray[np.bool_], sample: PairSample) -> Estimate | None:
    """Return the share of accepted pairs of a kind (P,), with its interval; None without such pairs."""
    if not kind.any():
        return None
    hits = accepted[kind].astype(np.float64)
    parts = [part for part in np.array_split(hits, min(_STRETCHES, len(hits))) if len(part)]
    over_stretches = estimates([SampleGroup("", part[:, None]) for part in parts])[0]
    half = (over_stretches.high - over_stretches.low) / 2
    of_pairs = binomtest(int(hits.sum()), len(hits)).proportion_ci()
    mean = float(hits.mean())
    return Estimate(mean, min(mean - half, float(of_pairs.low)), max(mean + half, float(of_pairs.high))).within(0, 1)


def _recall_at(score: NDArray[np.float64], near: NDArray[np.bool_], far_fpr: float) -> float | None:
    """Return the share of near pairs above a threshold that at most a share `far_fpr` of the far pairs exceeds."""
    far = np.sort(score[~near])[::-1]
    allowed = int(far_fpr * len(far) + 1e-9)
    if not allowed or not near.any():
        return None
    return float((score[near] > far[allowed]).mean())


def _as_many_of_both(near: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.intp]:
    """Return rows of equal numbers of near and far pairs."""
    rows = np.flatnonzero(near), np.flatnonzero(~near)
    count = min(map(len, rows))
    return np.concatenate([rng.choice(kind, count, replace=False) for kind in rows])


def _by_distance(scores: PairScores) -> tuple[DistanceBin, ...]:
    moved = np.hypot(*scores.sample.waypoints[:, :2].T)
    rows = [
        (low, high, scores.accepted[scores.sample.is_near & (moved >= low) & (moved < high)])
        for low, high in pairwise(_DISTANCES_M)
    ]
    return tuple(
        DistanceBin(low_m=low, high_m=high, pairs=len(hits), recall=float(hits.mean()) if len(hits) else None)
        for low, high, hits in rows
    )
