"""Two other filters of presence, and the paper's system with each of them: how to bring a filter of your own.

FreMEn takes presence for a mean and the strongest of some periods (Krajnik et al., IEEE T-RO 2017). The filter that
forgets lets what was seen count less and less, until only what is usual is left; it is exact for a thing that goes and
comes at any moment, with no memory of how long it has been there.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import ltvn_core as ltvn
from ltvn_core.graph.presence.presence_filter import EDGE_ERRORS, USUALLY_PRESENT, FloatArray, Rows, SightErrors
from ltvn_core.systems.maintenance import with_presence_filter

HOUR_S = 3600.0
WEEK_S = 7 * 24 * HOUR_S


@dataclass(frozen=True, slots=True, eq=False)
class FremenFilter:
    """A Fourier series of presence over time."""

    periods_s: FloatArray
    """(P,) periods that presence may have."""
    order: int = 2
    """How many of them, the strongest, make the answer."""
    present_at_first: float = 0.9
    """How probably a thing is there before it was ever looked for; counts as much as one look."""

    def follow(self, count: int) -> "_FremenTracks":
        """Begin to follow things."""
        return _FremenTracks(self, count)


class _FremenTracks:
    def __init__(self, config: FremenFilter, count: int) -> None:
        self._rates = 2 * np.pi / config.periods_s
        self._order = min(config.order, len(self._rates))
        self._looks = np.ones(count)
        self._found = np.full(count, config.present_at_first)
        self._found_waves = np.zeros((count, len(self._rates)), np.complex128)
        self._waves = np.zeros_like(self._found_waves)

    def observe(self, rows: Rows, present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Add one observation of each thing to the sums."""
        waves = np.exp(-1j * stamps_s[:, None] * self._rates)
        self._looks[rows] += 1
        self._found[rows] += present
        self._waves[rows] += waves
        self._found_waves[rows] += waves * present[:, None]

    def probability(self, at_s: float) -> FloatArray:
        """Return (N,) the mean and the strongest periods at a moment, within [0, 1]."""
        mean = self._found / self._looks
        strengths = (self._found_waves - mean[:, None] * self._waves) / self._looks[:, None]
        weakest_first = np.argsort(np.abs(strengths), axis=1)
        strongest = weakest_first[:, strengths.shape[1] - self._order :]
        waves = strengths * np.exp(1j * at_s * self._rates)
        return np.clip(mean + 2 * np.take_along_axis(waves, strongest, axis=1).real.sum(axis=1), 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ForgettingFilter:
    """A two-state Markov process with uncertain looks."""

    usual: FloatArray
    """() or (N,) share of the time that a thing is there."""
    memory_s: FloatArray
    """() or (N,) seconds after which what was known counts 1/e."""
    errors: SightErrors

    def follow(self, count: int) -> "_ForgettingTracks":
        """Begin to follow things."""
        return _ForgettingTracks(self, count)


class _ForgettingTracks:
    def __init__(self, config: ForgettingFilter, count: int) -> None:
        self._usual = np.broadcast_to(config.usual, count)
        self._memory_s = np.broadcast_to(config.memory_s, count)
        self._errors = config.errors
        self._p = self._usual.astype(np.float64)
        self._last = np.zeros(count)

    def observe(self, rows: Rows, present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Forget up to the observation, and apply Bayes' rule."""
        p = self._faded(rows, stamps_s)
        errors = self._errors
        if_there = np.where(present, 1 - errors.miss, errors.miss)
        if_not = np.where(present, errors.false_alarm, 1 - errors.false_alarm)
        self._p[rows] = if_there * p / (if_there * p + if_not * (1 - p))
        self._last[rows] = stamps_s

    def probability(self, at_s: float) -> FloatArray:
        """Return (N,) what is left of what was known."""
        rows = np.arange(len(self._p))
        return self._faded(rows, np.full(len(rows), at_s))

    def _faded(self, rows: Rows, stamps_s: FloatArray) -> FloatArray:
        kept = np.exp(-np.maximum(stamps_s - self._last[rows], 0.0) / self._memory_s[rows])
        return self._usual[rows] + kept * (self._p[rows] - self._usual[rows])


FORGETTING = ForgettingFilter(usual=np.array(USUALLY_PRESENT), memory_s=np.array(HOUR_S), errors=EDGE_ERRORS)
"""Of an edge, of which nothing is known, and which is known no more an hour after it was seen."""

FREMEN = FremenFilter(periods_s=WEEK_S / np.arange(1, 7 * 12 + 1), present_at_first=USUALLY_PRESENT)
"""With periods from two hours to a week."""


def forgetting_system(method: ltvn.Method) -> ltvn.NavigationSystem:
    """Return the paper's system, which plans by what it saw in the last hours."""
    return replace(with_presence_filter(ltvn.open_system("ltvn", method), FORGETTING), name="forgetting")


def fremen_system(method: ltvn.Method) -> ltvn.NavigationSystem:
    """Return the paper's system, which plans by what is open at this time of the day or of the week."""
    return replace(with_presence_filter(ltvn.open_system("ltvn", method), FREMEN), name="fremen")
