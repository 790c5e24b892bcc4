"""Presence filters: estimate from observations the probability that a thing is present at a later moment.

Owns the interface, and filtering whole histories. The default filter is `graph.presence.persistent`.
"""

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.presence.durations import FloatArray


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
