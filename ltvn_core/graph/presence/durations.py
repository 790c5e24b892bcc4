"""Distributions of the time in one state: mixtures of Weibull distributions, which are exponential at shape 1.

Owns the formulas, in logarithms. `graph.presence.persistent` updates the weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DurationMixture:
    """Mixture of K components for the duration of a state, shared by all things (K,) or for each of N things (N, K)."""

    scales_s: FloatArray
    """Weibull scales in seconds, after which 1 - 1/e of a component's durations are over; positive."""
    shapes: FloatArray
    """Weibull shapes: at 1 a state may end at any time; larger ones give more similar durations; positive."""
    weights: FloatArray
    """Weights of the components, which sum to 1 over the last axis."""

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
        """Return a mixture of exponential distributions."""
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
    """Return ln of the probability that a duration exceeds an age (survival function); all arguments broadcast."""
    return -((np.maximum(ages_s, 0.0) / scales_s) ** shapes)


def log_ended_between(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return ln(exp(before) - exp(after)) for the ln of survival at an age and a later age; -inf if they are equal."""
    with np.errstate(divide="ignore"):
        return before + np.log(-np.expm1(np.minimum(after - before, 0.0)))
