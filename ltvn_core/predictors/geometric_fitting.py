"""How a calibration of the geometric predictor is fitted: which poses are right, and the logistic regression.

Owns the loss, its ridge and the signs that weights may have. The pairs come from `tools/fit_geometric.py` for the
package, and from a drive for `geometric_adaptation`.
"""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.predictors.geometric_calibration import DEPTHS, Logistic
from ltvn_core.predictors.geometric_evidence import Evidence
from ltvn_core.types import Waypoint

PAIRS_FILE = Path(__file__).with_name("geometric_pairs.npz")
"""The pairs that the calibration of the package was fitted on."""

RIDGE = 1.0
"""Strength of the regularisation of standardised weights."""
RIGHT_M, RIGHT_SHARE, RIGHT_RAD = 0.12, 0.12, np.deg2rad(8)
"""A pose is right when it is off by less than this, or this share of the distance, and turned by less."""
GUESSED_M, GUESSED_SHARE = 0.3, 0.6
"""The same for the guessed distances of images without depth."""
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
"""Which way each number may count, so that a regression does not learn the habits of the images it saw."""


class Comparisons(NamedTuple):
    """P pairs with a pose each, of one number of images with depth."""

    evidence: NDArray[np.float64]
    """(P, E)"""
    right: NDArray[np.bool_]
    """(P,): the pose is right."""
    weight: NDArray[np.float64]
    """(P,): counts so much."""

    def joined(self, other: "Comparisons") -> "Comparisons":
        """Return both together."""
        return Comparisons(
            np.concatenate([self.evidence, other.evidence]),
            np.concatenate([self.right, other.right]),
            np.concatenate([self.weight, other.weight]),
        )

    def weighing(self, total: float) -> "Comparisons":
        """Return the same pairs, which count so much together."""
        return self._replace(weight=self.weight * total / max(float(self.weight.sum()), 1e-9))


NO_COMPARISONS = Comparisons(np.zeros((0, len(Evidence._fields))), np.zeros(0, bool), np.zeros(0))


def is_right(found: Waypoint, truth: Waypoint, *, measured: bool) -> bool:
    """Tell whether a waypoint (3,) is near enough to the truth, its distance `measured` by depth or guessed."""
    gap = relative(truth, found)
    least, share = (RIGHT_M, RIGHT_SHARE) if measured else (GUESSED_M, GUESSED_SHARE)
    allowed = max(least, share * float(np.hypot(truth[0], truth[1])))
    return float(np.hypot(gap[0], gap[1])) < allowed and abs(float(wrap_angle(gap[2]))) < RIGHT_RAD


def probabilities(logistic: Logistic, evidence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how likely poses with evidence (P, E) are right, (P,)."""
    total = logistic.bias + evidence @ _weights(logistic)
    return 1 / (1 + np.exp(-np.clip(total, -30, 30)))


def fit_logistic(found: Comparisons, parent: Logistic | None = None, ridge: float = RIDGE) -> Logistic:
    """Return the logistic regression of pairs.

    A ridge on standardised evidence holds its weights at zero; where there is a parent it holds weights and bias at
    the parent's, so that few pairs change little.
    """
    mean, spread = found.evidence.mean(0), found.evidence.std(0) + 1e-6
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
    # A number that never changes says nothing, and its tiny spread would make rounding errors a weight.
    known = np.where(spread > 1e-5, fitted[:-1] / spread, 0.0 if parent is None else _weights(parent))
    return logistic(known, float(fitted[-1] - known @ mean))


def logistic(weights: NDArray[np.float64], bias: float) -> Logistic:
    """Return a regression with weights (E,), rounded as they are written."""
    named = zip(Evidence._fields, weights, strict=True)
    return Logistic({name: round(float(weight), 4) for name, weight in named}, round(bias, 4))


def _weights(part: Logistic) -> NDArray[np.float64]:
    return np.array([part.weights[name] for name in Evidence._fields])


@lru_cache(maxsize=1)
def shipped_comparisons() -> Mapping[str, Comparisons]:
    """Return the pairs that the calibration of the package was fitted on, by how many of their images have depth."""
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
    """Write the pairs beside the calibration of the package."""
    held = {}
    for name, part in found.items():
        held[f"{name}_evidence"] = part.evidence.astype(np.float16)
        held[f"{name}_right"] = part.right
        held[f"{name}_weight"] = part.weight.astype(np.float16)
    np.savez_compressed(PAIRS_FILE, **held)
    shipped_comparisons.cache_clear()
