"""Confidence intervals of means over grouped cases: Student's interval over groups, pooled within strata. Numpy only.

The method was chosen by simulation. With three map seeds per scene and a standard deviation of 12 percentage points of
success between seeds, its 95 % intervals contained the true mean in 93 to 95 % of cases. A bootstrap of seeds and then
of episodes reached only 76 to 84 %, because three groups are too few to resample.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ltvn_core.network.metrics import SuccessRate

CONFIDENCE_LEVEL = 0.95


class Estimate(NamedTuple):
    """A mean with its 95 % confidence interval."""

    mean: float
    low: float
    high: float

    def within(self, low: float, high: float) -> "Estimate":
        """Return the estimate with its interval clipped to possible values."""
        return Estimate(self.mean, max(self.low, low), min(self.high, high))

    def covering(self, rate: SuccessRate) -> "Estimate":
        """Return the estimate with its interval widened, if necessary, to contain that of a success rate."""
        return Estimate(self.mean, min(self.low, rate.low), max(self.high, rate.high))


@dataclass(frozen=True, slots=True, eq=False)
class SampleGroup:
    """Cases that are not independent of each other, such as the episodes of one map seed."""

    stratum: str
    """Stratum of the group, such as a scene; groups are compared only within a stratum."""
    values: NDArray[np.float64]
    """(cases, quantities) measured values."""


class _Spread(NamedTuple):
    variance: NDArray[np.float64]
    """(Q,) variance of the mean."""
    freedom: NDArray[np.float64]
    """(Q,) degrees of freedom; 0 if the variance is unknown."""

    def half_width(self) -> NDArray[np.float64]:
        quantile = stdtrit(np.maximum(self.freedom, 1), (1 + CONFIDENCE_LEVEL) / 2)
        return np.where(self.freedom > 0, quantile * np.sqrt(self.variance), 0.0)

    def plus(self, other: "_Spread") -> "_Spread":
        """Return the spread of a difference, with the degrees of freedom of Welch and Satterthwaite."""
        variance = self.variance + other.variance
        parts = sum(each.variance**2 / np.maximum(each.freedom, 1) for each in (self, other))
        alike = self.freedom + other.freedom
        return _Spread(variance, np.divide(variance**2, parts, out=alike.copy(), where=parts > 0))


def estimates(samples: Sequence[SampleGroup], minus: Sequence[SampleGroup] | None = None) -> list[Estimate]:
    """Return, for each quantity, the mean over groups of the mean over cases, less the mean of `minus` if given.

    The interval is at least as wide as one over single cases. Raises ValueError if there is no group, or if a group has
    no cases.
    """
    mean = _mean(samples)
    spreads = (_between(samples), _within(samples))
    if minus is not None:
        mean = mean - _mean(minus)
        spreads = spreads[0].plus(_between(minus)), spreads[1].plus(_within(minus))
    half = np.maximum(spreads[0].half_width(), spreads[1].half_width())
    return [Estimate(*map(float, row)) for row in zip(mean, mean - half, mean + half, strict=True)]


def _mean(samples: Sequence[SampleGroup]) -> NDArray[np.float64]:
    """Return the mean over groups of their means (Q,)."""
    if not samples or any(len(sample.values) == 0 for sample in samples):
        raise ValueError("A mean needs at least one trial, and each trial at least one episode.")
    return np.mean([sample.values.mean(0) for sample in samples], axis=0)


def _between(samples: Sequence[SampleGroup]) -> _Spread:
    """Return the variance of the mean from the scatter between groups of one stratum."""
    strata: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    for sample in samples:
        strata[sample.stratum].append(sample.values.mean(0))
    squares = np.sum([np.var(means, axis=0) * len(means) for means in strata.values()], axis=0)
    freedom = len(samples) - len(strata)
    return _Spread(squares / max(freedom, 1) / len(samples), np.full(squares.shape, float(freedom)))


def _within(samples: Sequence[SampleGroup]) -> _Spread:
    """Return the variance of the mean from the scatter between cases of one group."""
    variances = [sample.values.var(0) / max(len(sample.values) - 1, 1) for sample in samples]
    variance = np.sum(variances, axis=0) / len(samples) ** 2
    return _Spread(variance, np.full(variance.shape, float(sum(len(sample.values) - 1 for sample in samples))))
