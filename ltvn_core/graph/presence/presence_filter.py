"""Presence filters: estimate from observations the probability that a thing is present at a later moment.

Owns the interface, filtering whole histories, and distributions of the time in one state: mixtures of Weibull
distributions, which are exponential at shape 1. The default filter is `graph.presence.persistent`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple, Protocol

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


class PresenceObservation(NamedTuple):
    """An observation that a thing is present or absent."""

    present: bool
    stamp_s: float
    """Seconds on the clock of the world."""


Rows = NDArray[np.intp]
"""(M,) rows of different things."""


class PresenceTracks(Protocol):
    """State of a filter over N things."""

    def observe(self, rows: Rows, present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Update with one observation of each of M different things; those of one thing come in order of time.

        Args:
            rows: (M,) rows of the things.
            present: (M,) whether they were seen to be present.
            stamps_s: (M,) times of the observations, in seconds on the clock of the world.
        """
        ...

    def probability(self, at_s: float) -> FloatArray:
        """Return the probabilities (N,) that things are present at a moment, not before their last observations."""
        ...


class PresenceFilter(Protocol):
    """Turns observations into a probability."""

    def follow(self, count: int) -> PresenceTracks:
        """Start filters for a number of things without observations."""
        ...


def presence_probabilities(
    presence_filter: PresenceFilter, histories: Sequence[Sequence[PresenceObservation]], now_s: float
) -> FloatArray:
    """Return the probabilities (N,) that things are present at a moment, given their observations up to then, in order
    of time.

    Linear in the longest history, with vectors over the things.
    """
    known = [[each for each in history if each.stamp_s <= now_s] for history in histories]
    return follow_histories(presence_filter, known).probability(now_s)


def follow_histories(
    presence_filter: PresenceFilter, histories: Sequence[Sequence[PresenceObservation]]
) -> PresenceTracks:
    """Return the state of a filter after the histories of N things, each in order of time."""
    tracks = presence_filter.follow(len(histories))
    for seen in zip_longest(*histories):
        rows = np.array([row for row, each in enumerate(seen) if each is not None], np.intp)
        present = np.array([each.present for each in seen if each is not None], np.bool_)
        stamps = np.array([each.stamp_s for each in seen if each is not None], np.float64)
        tracks.observe(rows, present, stamps)
    return tracks
