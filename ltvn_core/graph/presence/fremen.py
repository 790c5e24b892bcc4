"""FreMEn: presence as a mean and the strongest of some periods (Krajnik et al., IEEE T-RO 2017)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.presence.durations import FloatArray
from ltvn_core.graph.presence.presence_filter import Rows


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
