"""The filter of presence with the constants that suit recorded things, learned from looks at them alone.

Owns what is learned, and the simplest filter to compare it with, the last look. Reads no truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.presence.duration_fit import Stays, fit_durations, stays_of
from ltvn_core.evaluation.presence.sequences import PresenceSequence
from ltvn_core.graph.presence.durations import DurationMixture
from ltvn_core.graph.presence.persistent import PersistentFilter, SightErrors
from ltvn_core.graph.presence.presence_filter import PresenceFilter

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FittedFilter:
    """A filter for certain things, and what tables call it."""

    name: str
    presence_filter: PresenceFilter
    things: int
    """How many things it is for."""


def fit_filters(things: Sequence[PresenceSequence], errors: SightErrors) -> list[FittedFilter]:
    """Return all filters that are compared, fitted to looks at the same things on another day."""
    stays = [stays_of(thing, errors) for thing in things]
    shares = np.array([each.share_present for each in stays])
    filters: dict[str, PresenceFilter] = {
        "last look": LastLook(),
        "persistent": _persistent(stays, shares, errors),
    }
    return [FittedFilter(name, each, len(things)) for name, each in filters.items()]


def _persistent(stays: Sequence[Stays], shares: FloatArray, errors: SightErrors) -> PersistentFilter:
    present = [fit_durations(each.present_s, never_ended_s=each.length_s) for each in stays]
    absent = [fit_durations(each.absent_s, never_ended_s=each.length_s) for each in stays]
    return PersistentFilter(
        present=_stacked(present),
        absent=_stacked(absent),
        errors=errors,
        present_at_first=float(np.clip(shares.mean(), 0.05, 0.95)),
        prior_stays=float(np.mean([len(each.present_s) for each in stays])) + 1,
    )


def _stacked(mixtures: Sequence[DurationMixture]) -> DurationMixture:
    """Return one mixture (N, K) of N mixtures; kinds that one has less get no weight."""
    kinds = max(len(each.weights) for each in mixtures)

    def column(name: str, filling: float) -> FloatArray:
        values = [getattr(each, name) for each in mixtures]
        return np.stack([np.pad(each, (0, kinds - len(each)), constant_values=filling) for each in values])

    return DurationMixture(
        scales_s=column("scales_s", 1.0),
        shapes=column("shapes", 1.0),
        weights=column("weights", 0.0),
    )


@dataclass(frozen=True, slots=True)
class LastLook:
    """The filter that believes the last look."""

    def follow(self, count: int) -> "_LastLooks":
        """Begin with everything there."""
        return _LastLooks(np.ones(count))


@dataclass(frozen=True, slots=True, eq=False)
class _LastLooks:
    found: FloatArray

    def observe(self, rows: NDArray[np.intp], present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Replace what was believed."""
        self.found[rows] = present

    def probability(self, at_s: float) -> FloatArray:
        """Return (N,) ones and zeros."""
        return self.found.copy()
