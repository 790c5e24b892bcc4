"""Learns from noisy looks at a thing how long it uses to stay, and how long it uses to stay away.

Owns cutting looks into stays and fitting mixtures to their lengths. Reads no truth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.presence.sequences import PresenceSequence
from ltvn_core.graph.presence.durations import DurationMixture
from ltvn_core.graph.presence.persistent import SightErrors

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
