"""Fits a calibration of the geometric predictor, and adapts it to one drive.

Owns the tolerance for right poses, the logistic regression with its ridge and the allowed signs of its weights, and the
adaptation. A candidate is fitted to the pairs of a drive with the parent as prior, cross-validated on sections of the
drive, and used only if it is better. The caller supplies the compared pairs: `tools/fit_geometric.py` those of the
package, fine-tuning those of a drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ltvn_core.config import ROBUST
from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.predictors.geometric_evidence import DEPTHS, Calibration, Evidence, Logistic
from ltvn_core.types import Waypoint

PAIRS_FILE = Path(__file__).with_name("geometric_pairs.npz")
"""File of the pairs to which the calibration of the package was fitted."""

RIDGE = 1.0
"""Strength of the regularisation of standardised weights."""
RIGHT_M, RIGHT_SHARE, RIGHT_RAD = 0.12, 0.12, np.deg2rad(8)
"""Tolerances of a right pose: position error in metres or as a share of the distance, and angle error in radians."""
GUESSED_M, GUESSED_SHARE = 0.3, 0.6
"""Tolerances of the position for images without depth, whose distance is guessed, in metres or as a share."""
SIGNS = Evidence(
    agreeing=1,
    agreeing_share=1,
    repeated_share=1,
    spread=1,
    overlap=1,
    depth_agreement=1,
    depth_conflict=-1,
    brightness=1,
    colour_conflict=-1,
    colour_gap=-1,
    rival=-1,
    tilt_gap=-1,
    uncertainty=-1,
)
"""Allowed sign of each weight, so that a regression does not overfit to chance correlations in its images."""


class Comparisons(NamedTuple):
    """P pairs with a pose each, all with the same number of depth images."""

    evidence: NDArray[np.float64]
    """(P, E) evidence for the poses."""
    right: NDArray[np.bool_]
    """(P,) whether the pose is right."""
    weight: NDArray[np.float64]
    """(P,) sample weight."""

    def joined(self, other: "Comparisons") -> "Comparisons":
        """Return the pairs of both."""
        return Comparisons(
            np.concatenate([self.evidence, other.evidence]),
            np.concatenate([self.right, other.right]),
            np.concatenate([self.weight, other.weight]),
        )

    def weighing(self, total: float) -> "Comparisons":
        """Return the same pairs with their weights scaled to a total."""
        return self._replace(weight=self.weight * total / max(float(self.weight.sum()), 1e-9))


def is_right(found: Waypoint, truth: Waypoint, *, measured: bool) -> bool:
    """Return whether a waypoint (3,) is close enough to the truth; its distance is `measured` by depth or guessed."""
    gap = relative(truth, found)
    least, share = (RIGHT_M, RIGHT_SHARE) if measured else (GUESSED_M, GUESSED_SHARE)
    allowed = max(least, share * float(np.hypot(truth[0], truth[1])))
    return float(np.hypot(gap[0], gap[1])) < allowed and abs(float(wrap_angle(gap[2]))) < RIGHT_RAD


def probabilities(logistic: Logistic, evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probabilities (P,) that poses with evidence (P, E) are right."""
    total = logistic.bias + evidence @ _weights(logistic)
    return 1 / (1 + np.exp(-np.clip(total, -30, 30)))


def fit_logistic(found: Comparisons, parent: Logistic | None = None, ridge: float = RIDGE) -> Logistic:
    """Return the logistic regression of pairs.

    A ridge penalty on standardised evidence draws the weights towards zero or, with a parent, weights and bias towards
    the parent's, so that few pairs change little.
    """
    mean = found.evidence.mean(0)
    spread = found.evidence.std(0) + 1e-6
    inputs = np.column_stack([(found.evidence - mean) / spread, np.ones(len(found.right))])
    signs = np.where(found.right, 1.0, -1.0)
    start = np.zeros(inputs.shape[1])
    holds = np.append(np.full(len(mean), ridge), 0.0)
    if parent is not None:
        weights = _weights(parent)
        start = np.append(weights * spread, parent.bias + weights @ mean)
        holds[-1] = ridge

    def loss(parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margins = signs * (inputs @ parameters)
        slope = -found.weight * signs / (1 + np.exp(np.clip(margins, -30, 30)))
        moved = parameters - start
        pull = holds * moved
        return float(found.weight @ np.logaddexp(0, -margins) + moved @ pull / 2), inputs.T @ slope + pull

    bounds = [(0, None) if sign > 0 else (None, 0) for sign in SIGNS] + [(None, None)]
    fitted = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    # Constant evidence has no information, and its tiny spread would turn rounding errors into a weight.
    known = np.where(spread > 1e-5, fitted[:-1] / spread, 0.0 if parent is None else _weights(parent))
    return logistic(known, float(fitted[-1] - known @ mean))


def logistic(weights: NDArray[np.float64], bias: float) -> Logistic:
    """Return a regression with weights (E,), rounded as in its file."""
    named = zip(Evidence._fields, weights, strict=True)
    return Logistic({name: round(float(weight), 4) for name, weight in named}, round(bias, 4))


def _weights(part: Logistic) -> NDArray[np.float64]:
    return np.array([part.weights[name] for name in Evidence._fields])


@lru_cache(maxsize=1)
def shipped_comparisons() -> Mapping[str, Comparisons]:
    """Return the pairs to which the calibration of the package was fitted, by the number of depth images."""
    with np.load(PAIRS_FILE) as held:
        return {
            name: Comparisons(
                held[f"{name}_evidence"].astype(np.float64),
                held[f"{name}_right"],
                held[f"{name}_weight"].astype(np.float64),
            )
            for name in DEPTHS
        }


def write_comparisons(found: Mapping[str, Comparisons]) -> None:
    """Write the pairs to the file beside the calibration of the package."""
    held = {}
    for name, part in found.items():
        held[f"{name}_evidence"] = part.evidence.astype(np.float16)
        held[f"{name}_right"] = part.right
        held[f"{name}_weight"] = part.weight.astype(np.float16)
    np.savez_compressed(PAIRS_FILE, **held)
    shipped_comparisons.cache_clear()


RIDGES = (3.0, 10.0, 30.0, 100.0)
"""Candidate strengths of the ridge penalty towards the parent; the best one in cross-validation is used."""
CAUTIONS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
"""Candidate values that are subtracted from a fitted bias, in log odds, to accept fewer pairs."""
STRETCHES = 4
"""Number of folds of the cross-validation; each is one section of the drive."""
ALLOWED_FAR = 1e-3
"""Share of the far pairs that may be accepted; candidates within this limit are preferred."""
FEWEST_RIGHT = 20
"""Least number of right poses with the same number of depth images for fitting that regression."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnPairs:
    """P pairs of a drive of N images that were compared in full."""

    source: NDArray[np.intp]
    """(P,) rows of the source images."""
    target: NDArray[np.intp]
    """(P,) rows of the target images."""
    images: int
    """Number of images, N."""
    near: NDArray[np.bool_]
    """(P,) whether the pair is near, so that an edge should join it."""
    far: NDArray[np.bool_]
    """(P,) whether the pair is far, so that an edge would be wrong."""
    known: NDArray[np.bool_]
    """(P,) whether it is known if the pose is right."""
    right: NDArray[np.bool_]
    """(P,) whether the pose is right."""
    depths: NDArray[np.intp]
    """(P,) number of the two images that have depth."""
    found: NDArray[np.bool_]
    """(P,) whether a pose was found."""
    evidence: NDArray[np.float64]
    """(P, E) evidence for the pose; zeros without a pose."""
    share: NDArray[np.float64]
    """(P,) ratio of r to the certainty of the pose, see `drivable_share`; 0 if too far apart for an
    edge."""
    far_pairs: int
    """Number of all far pairs of the drive, including those that the shortlist leaves out."""

    @property
    def stretch(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Cross-validation folds (P,) of source and target."""
        return self.source * STRETCHES // self.images, self.target * STRETCHES // self.images

    def comparisons(self, depths: int, chosen: NDArray[np.bool_]) -> Comparisons:
        """Return the chosen pairs (P,) with `depths` depth images and a pose known to be right or wrong."""
        rows = chosen & self.found & self.known & (self.depths == depths)
        return Comparisons(self.evidence[rows], self.right[rows], np.ones(np.count_nonzero(rows)))


@dataclass(frozen=True, slots=True, eq=False)
class Rescaled:
    """The pairs of a drive with another room depth, the scale of guessed distances."""

    pairs: OwnPairs
    room_depth_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """Shares of a drive's pairs that a calibration accepts as edges: r > R_c and d < D_c."""

    near_recall: float
    """Share of the near pairs that are accepted."""
    far_fpr: float
    """Share of the far pairs that are accepted."""
    shipped_fpr: float
    """Share of the wrong poses with r > R_c, in the pairs to which the package's calibration was fitted."""

    def is_worse_than(self, other: "Acceptance") -> bool:
        """Return whether it accepts fewer near pairs, more far pairs or more wrong poses."""
        return (
            self.near_recall < other.near_recall or self.far_fpr > other.far_fpr or self.shipped_fpr > other.shipped_fpr
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Adaptation:
    """An adapted calibration, and its cross-validation on the drive."""

    calibration: Calibration
    """The calibration, without a card."""
    before: Acceptance
    """Acceptance by the parent's calibration."""
    after: Acceptance
    """Acceptance in cross-validation by the adapted calibration; equal to `before` if the parent is kept."""
    ridge: float | None = None
    """Strength of the ridge penalty; None if no candidate is better than the parent's weights."""
    caution: float = 0.0
    """Value that was subtracted from the fitted bias, in log odds."""


def adapt(
    pairs: OwnPairs, parent: Calibration, shipped: Mapping[str, Comparisons], rescaled: Rescaled | None = None
) -> Adaptation:
    """Adapt the parent to a drive.

    A candidate must not accept fewer near pairs than the parent, more far pairs, or more of the shipped wrong poses.
    Among the remaining candidates, those with at most a share of `ALLOWED_FAR` far pairs are preferred, then the one
    with the most near pairs.

    Args:
        pairs: Pairs of the drive, with the parent's room depth.
        parent: Calibration to start from.
        shipped: Pairs to which the calibration of the package was fitted, by the number of depth images.
        rescaled: The same pairs with another room depth, which is used unless it is worse.
    """
    before = _acceptance(pairs, _across(pairs, [parent.logistics] * STRETCHES), parent.logistics, shipped)
    best = Adaptation(calibration=replace(parent, card={}), before=before, after=before)
    if rescaled is not None:
        moved = _across(rescaled.pairs, [parent.logistics] * STRETCHES)
        after = _acceptance(rescaled.pairs, moved, parent.logistics, shipped)
        if not after.is_worse_than(before):
            pairs = rescaled.pairs
            calibration = replace(best.calibration, room_depth_m=rescaled.room_depth_m)
            best = replace(best, calibration=calibration, after=after)
    for ridge in RIDGES:
        whole = _fitted(pairs, np.ones(len(pairs.source), bool), parent, shipped, ridge)
        folds = [_fitted(pairs, _outside(pairs, k), parent, shipped, ridge) for k in range(STRETCHES)]
        for caution in CAUTIONS:
            logistics = _cautious(whole, parent, caution)
            across = _across(pairs, [_cautious(each, parent, caution) for each in folds])
            after = _acceptance(pairs, across, logistics, shipped)
            if not after.is_worse_than(before) and _rank(after) > _rank(best.after):
                calibration = replace(best.calibration, logistics=logistics)
                best = replace(best, calibration=calibration, after=after, ridge=ridge, caution=caution)
    return best


def _rank(found: Acceptance) -> tuple[bool, float, float]:
    return found.far_fpr <= ALLOWED_FAR, found.near_recall, -found.far_fpr


def _outside(pairs: OwnPairs, stretch: int) -> NDArray[np.bool_]:
    """Return a mask (P,) of the pairs without an image in a fold."""
    source, target = pairs.stretch
    return (source != stretch) & (target != stretch)


def _fitted(
    pairs: OwnPairs,
    chosen: NDArray[np.bool_],
    parent: Calibration,
    shipped: Mapping[str, Comparisons],
    ridge: float,
) -> Mapping[str, Logistic]:
    """Return the regressions fitted to the chosen pairs (P,) and, with equal total weight, to the shipped ones."""
    logistics = dict(parent.logistics)
    for depths, name in enumerate(DEPTHS):
        own = pairs.comparisons(depths, chosen)
        if np.count_nonzero(own.right) >= FEWEST_RIGHT:
            together = own.joined(shipped[name].weighing(len(own.right)))
            logistics[name] = fit_logistic(together, parent.logistics[name], ridge)
    return logistics


def _cautious(logistics: Mapping[str, Logistic], parent: Calibration, caution: float) -> Mapping[str, Logistic]:
    """Return regressions with `caution` subtracted from the bias; those that were not adapted stay unchanged."""
    return {
        name: part if part is parent.logistics[name] else Logistic(part.weights, round(part.bias - caution, 4))
        for name, part in logistics.items()
    }


def _across(pairs: OwnPairs, by_stretch: Sequence[Mapping[str, Logistic]]) -> NDArray[np.bool_]:
    """Return which pairs (P,) are accepted, by regressions that were fitted without the stretch of their source."""
    accepted = np.zeros(len(pairs.source), bool)
    for (stretch, logistics), (depths, name) in product(enumerate(by_stretch), enumerate(DEPTHS)):
        rows = np.flatnonzero(pairs.found & (pairs.stretch[0] == stretch) & (pairs.depths == depths))
        reachability = probabilities(logistics[name], pairs.evidence[rows]) * pairs.share[rows]
        accepted[rows] = reachability > ROBUST.building.connect_reachability
    return accepted


def _acceptance(
    pairs: OwnPairs,
    accepted: NDArray[np.bool_],
    logistics: Mapping[str, Logistic],
    shipped: Mapping[str, Comparisons],
) -> Acceptance:
    return Acceptance(
        near_recall=float(accepted[pairs.near].mean()) if pairs.near.any() else 0.0,
        far_fpr=np.count_nonzero(accepted & pairs.far) / max(pairs.far_pairs, 1),
        shipped_fpr=_shipped_fpr(logistics, shipped),
    )


def _shipped_fpr(logistics: Mapping[str, Logistic], shipped: Mapping[str, Comparisons]) -> float:
    accepted = 0.0
    total = 0.0
    for name, part in shipped.items():
        wrong = ~part.right
        sure = probabilities(logistics[name], part.evidence[wrong]) > ROBUST.building.connect_reachability
        accepted += float(part.weight[wrong] @ sure)
        total += float(part.weight[wrong].sum())
    return accepted / max(total, 1e-9)
