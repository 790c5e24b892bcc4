"""How sure a mean is whose samples come in groups: a bootstrap in two stages. Pure numpy, repeatable.

Owns the resampling; what is averaged is `evaluate.metrics`. With few groups in a stratum the percentile interval tends
to be too narrow for the scatter between groups; that cases are drawn anew within each makes up for part of it.
`scipy.stats.bootstrap` knows no groups, so the drawing is done here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

REPLICATES = 2000
LEVEL = 0.95
_SEED = 0


class Estimate(NamedTuple):
    """A mean and the ends of its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A group of cases that were found together."""

    stratum: str
    """Groups are exchanged for others of the same stratum only."""
    values: NDArray[np.float64]
    """(cases, quantities)"""


def estimates(samples: Sequence[Sample], minus: Sequence[Sample] | None = None) -> list[Estimate]:
    """Return the mean over groups of the means over cases, for each quantity; less those of `minus`, if given.

    Raises ValueError if there is no group, or one without cases.
    """
    rng = np.random.default_rng(_SEED)
    mean, replicates = _mean(samples), _replicates(samples, rng)
    if minus is not None:
        mean, replicates = mean - _mean(minus), replicates - _replicates(minus, rng)
    low, high = np.quantile(replicates, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    # A lopsided bootstrap may leave the mean itself outside.
    low, high = np.minimum(low, mean), np.maximum(high, mean)
    return [Estimate(*map(float, row)) for row in zip(mean, low, high, strict=True)]


def _mean(samples: Sequence[Sample]) -> NDArray[np.float64]:
    """Return (Q,)."""
    if not samples or any(len(sample.values) == 0 for sample in samples):
        raise ValueError("A mean needs at least one trial, and at least one episode in each.")
    return np.mean([sample.values.mean(0) for sample in samples], axis=0)


def _replicates(samples: Sequence[Sample], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return (REPLICATES, Q) means of groups drawn within their stratum and of cases drawn within those."""
    total = np.zeros((REPLICATES, samples[0].values.shape[1]))
    for stratum in sorted({sample.stratum for sample in samples}):
        groups = [sample.values for sample in samples if sample.stratum == stratum]
        for drawn in rng.integers(len(groups), size=(len(groups), REPLICATES)):
            for number, values in enumerate(groups):
                here = np.flatnonzero(drawn == number)
                total[here] += _resampled_means(values, len(here), rng)
    return total / len(samples)


def _resampled_means(values: NDArray[np.float64], times: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return (times, Q) means of as many cases, drawn with replacement."""
    weights = rng.multinomial(len(values), np.full(len(values), 1 / len(values)), size=times)
    return weights @ values / len(values)
