"""The filter of presence with the constants that suit recorded things, learned from looks at them alone.

Owns how the lengths of stays are found and fitted, what is learned from them, and the simplest filter to compare it
with, the last look. Reads no truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.presence.sequences import PresenceSequence
from ltvn_core.graph.presence.durations import DurationMixture
from ltvn_core.graph.presence.persistent import PersistentFilter, SightErrors
from ltvn_core.graph.presence.presence_filter import PresenceFilter

FloatArray = NDArray[np.float64]

MOST_KINDS = 3
"""Kinds of stays that a mixture has at most."""
_EULER_GAMMA = 0.5772156649015329
_LEAST_SPREAD = 0.1
"""Least standard deviation of ln of a duration: stays are never held to be more alike."""
_STAY_S = 600.0
"""How long a stay is held to be before anything is known: shorter ones need more looks that agree."""
_ROUNDS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Stays:
    """The lengths of stays that began and ended within the looks."""

    present_s: FloatArray
    absent_s: FloatArray
    share_present: float
    """Of the time."""
    length_s: float
    """Of all looks."""


def stays_of(sequence: PresenceSequence, errors: SightErrors) -> Stays:
    """Cut the looks at a thing into stays, by its likeliest course."""
    present, times = likeliest_states(sequence, errors), sequence.looked_at_s
    changes = np.flatnonzero(present[1:] != present[:-1]) + 1
    lengths, kinds = np.diff(times[changes]), present[changes[:-1]]
    return Stays(
        present_s=lengths[kinds],
        absent_s=lengths[~kinds],
        share_present=float(np.average(present[:-1], weights=np.diff(times))) if len(times) > 1 else 0.5,
        length_s=float(times[-1] - times[0]),
    )


def likeliest_states(sequence: PresenceSequence, errors: SightErrors) -> NDArray[np.bool_]:
    """Return (L,) whether the thing was there at each look, in its likeliest course (Viterbi)."""
    found = np.where(sequence.found, np.log1p(-errors.miss), np.log(errors.miss))
    not_there = np.where(sequence.found, np.log(errors.false_alarm), np.log1p(-errors.false_alarm))
    gaps_s = np.diff(sequence.looked_at_s, prepend=sequence.looked_at_s[0])
    switch = np.log(np.clip(-np.expm1(-gaps_s / _STAY_S), 1e-9, 0.5))
    score = np.zeros(2)
    came_from = np.zeros((len(found), 2), np.intp)
    for k, looks in enumerate(np.stack([not_there, found], axis=1)):
        switched = score[::-1] + switch[k] > score
        came_from[k] = np.where(switched, [1, 0], [0, 1])
        score = np.where(switched, score[::-1] + switch[k], score) + looks
    states = np.empty(len(found), np.intp)
    states[-1] = int(score.argmax())
    for k in range(len(found) - 1, 0, -1):
        states[k - 1] = came_from[k, states[k]]
    return states > 0


def fit_durations(lengths_s: FloatArray, *, never_ended_s: float) -> DurationMixture:
    """Return the mixture of Weibull distributions that suits the lengths (M,) best by the Bayesian criterion (BIC).

    With less than three stays there is nothing to fit: they are held to end at any moment, as often as they did, or
    after twice `never_ended_s` if none ended.
    """
    if len(lengths_s) < 3:
        scale = float(lengths_s.mean()) if len(lengths_s) else 2 * never_ended_s
        return DurationMixture.exponential([max(scale, 1.0)], [1.0])
    fits = [_fit(np.log(lengths_s), kinds) for kinds in range(1, min(MOST_KINDS, len(lengths_s) // 2) + 1)]
    return min(fits, key=lambda fit: fit.bic).mixture


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    mixture: DurationMixture
    bic: float


def _fit(logs: FloatArray, kinds: int) -> _Fit:
    """Fit by expectation and maximisation."""
    mixture = _mixture_of(logs, _sorted_parts(logs, kinds))
    for _ in range(_ROUNDS):
        joint = _log_joint(logs, mixture)
        members = np.exp(joint - np.logaddexp.reduce(joint, axis=1, keepdims=True)) + 1e-9
        mixture = _mixture_of(logs, members / members.sum(axis=1, keepdims=True))
    likelihood = np.logaddexp.reduce(_log_joint(logs, mixture), axis=1).sum()
    return _Fit(mixture, float((3 * kinds - 1) * np.log(len(logs)) - 2 * likelihood))


def _mixture_of(logs: FloatArray, members: FloatArray) -> DurationMixture:
    """Return the mixture whose kinds have the moments of ln of their members (M, K)."""
    weights = members.mean(axis=0)
    means = (members * logs[:, None]).mean(axis=0) / weights
    spreads = np.sqrt((members * (logs[:, None] - means) ** 2).mean(axis=0) / weights)
    shapes = np.pi / np.sqrt(6) / np.maximum(spreads, _LEAST_SPREAD)
    return DurationMixture(
        scales_s=np.exp(means + _EULER_GAMMA / shapes), shapes=shapes, weights=weights / weights.sum()
    )


def _sorted_parts(logs: FloatArray, kinds: int) -> FloatArray:
    """Return (M, K) memberships to begin with: equal parts by length."""
    ranks = np.argsort(np.argsort(logs, kind="stable"), kind="stable")
    return np.eye(kinds)[ranks * kinds // len(logs)] * 0.9 + 0.1 / kinds


def _log_joint(logs: FloatArray, mixture: DurationMixture) -> FloatArray:
    """Return (M, K) ln of the weight of a kind times its density of ln t."""
    z = mixture.shapes * (logs[:, None] - np.log(mixture.scales_s))
    return np.log(np.maximum(mixture.weights, 1e-12)) + np.log(mixture.shapes) + z - np.exp(z)


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
