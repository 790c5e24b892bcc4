"""How long a thing stays in one state: mixtures of Weibull distributions, which are exponential at shape 1.

Owns the formulas, in logarithms. Learns nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DurationMixture:
    """How long a state lasts: K kinds of stays, the same for all things (K,) or for each of N things (N, K)."""

    scales_s: FloatArray
    """Seconds after which 1 - 1/e of the stays of a kind are over; positive."""
    shapes: FloatArray
    """1: a stay may end at any time; the greater, the more alike are the stays of a kind; positive."""
    weights: FloatArray
    """Share of the kinds; sums to 1 over the last axis."""

    def __post_init__(self) -> None:
        """Raise ValueError for an invalid mixture."""
        sizes = {self.scales_s.shape, self.shapes.shape, self.weights.shape}
        positive = np.all(self.scales_s > 0) and np.all(self.shapes > 0) and np.all(self.weights >= 0)
        if len(sizes) > 1 or not positive or not np.allclose(self.weights.sum(axis=-1), 1):
            raise ValueError(
                "A mixture of durations needs as many scales as shapes and weights, scales and shapes above 0 and "
                f"weights that sum to 1, got {self.scales_s}, {self.shapes} and {self.weights}."
            )

    @classmethod
    def exponential(cls, scales_s: Sequence[float], weights: Sequence[float]) -> "DurationMixture":
        """Return a mixture of stays that may end at any time."""
        scales = np.asarray(scales_s, np.float64)
        return cls(scales_s=scales, shapes=np.ones_like(scales), weights=np.asarray(weights, np.float64))

    def for_things(self, count: int) -> "DurationMixture":
        """Return the same mixture for each of `count` things, (N, K)."""
        size = (count, self.scales_s.shape[-1])
        return DurationMixture(
            scales_s=np.broadcast_to(self.scales_s, size),
            shapes=np.broadcast_to(self.shapes, size),
            weights=np.broadcast_to(self.weights, size),
        )


def log_survival(ages_s: FloatArray, scales_s: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return ln of the probability that a stay is longer than an age; all arguments broadcast."""
    return -((np.maximum(ages_s, 0.0) / scales_s) ** shapes)


def log_ended_between(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return ln(exp(before) - exp(after)) for ln of survival at an age and at a later one; -inf where nothing ended."""
    with np.errstate(divide="ignore"):
        return before + np.log(-np.expm1(np.minimum(after - before, 0.0)))
