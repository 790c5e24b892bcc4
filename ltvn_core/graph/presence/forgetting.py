"""The filter that forgets: what was seen counts less and less, until only what is usual is left.

This is the exact filter of a thing that goes and comes at any moment, with no memory of how long it has been there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.presence.durations import FloatArray
from ltvn_core.graph.presence.persistent import SightErrors
from ltvn_core.graph.presence.presence_filter import Rows


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
