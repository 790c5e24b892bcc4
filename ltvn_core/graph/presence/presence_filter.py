"""Presence filters: estimate from observations the probability that a thing is present at a later moment.

Owns the interface, filtering whole histories, distributions of the time in one state (mixtures of Weibull
distributions, which are exponential at shape 1), and the default filter with its constants for edges of a map.

That is the persistence filter for things that disappear and come back. A persistence filter (Rosen, Mason, Leonard,
ICRA 2016) runs while a thing is present, and its counterpart, an emergence filter, while it is absent. Both use
mixtures of durations, and the filter switches between them as in Perpetua (Saavedra-Ruiz, Nashed, Gauthier, Paull, IROS
2025, arXiv 2507.18808). Four changes are ours. All components of a mixture count by their weights, not only the
likeliest one. Their weights are learned from all durations that are over, not mostly from the last one. A switch keeps
the remaining uncertainty. Predictions use the renewal process of both states, by its integral equations on a time grid,
instead of a single sequence of switches.

The constants are ours, for edges that a robot drives occasionally. A person, a piece of furniture or a door may close
an edge, and the filter must learn from a few observations which of them it is.
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


def follow_histories(
    presence_filter: PresenceFilter, histories: Sequence[Sequence[PresenceObservation]]
) -> PresenceTracks:
    """Return the state of a filter after the histories of N things, each in order of time.

    Linear in the longest history, with vectors over the things.
    """
    tracks = presence_filter.follow(len(histories))
    for seen in zip_longest(*histories):
        rows = np.array([row for row, each in enumerate(seen) if each is not None], np.intp)
        present = np.array([each.present for each in seen if each is not None], np.bool_)
        stamps = np.array([each.stamp_s for each in seen if each is not None], np.float64)
        tracks.observe(rows, present, stamps)
    return tracks


def return_probabilities(own: FloatArray, other: FloatArray) -> FloatArray:
    """Return the probabilities (I, N) of being back in a state at times 0, 1, ... I-1 after leaving it.

    A is the probability of being in the state after entering it, B after leaving it, f the densities of durations and S
    their survival functions:

        A(t) = S_own(t) + integral of f_own(u) B(t - u) du,    B(t) = integral of f_other(u) A(t - u) du.

    Both equations of a step are solved together, to include durations that begin and end within one step of the grid.

    Args:
        own: (2 I - 1, N) survival function of the state, at every half step from 0 on.
        other: (2 I - 1, N) survival function of the other state.
    """
    own_steps = _StepEnds(own)
    other_steps = _StepEnds(other)
    count = len(own_steps.survival)
    in_state = np.ones_like(own_steps.survival)
    back = np.zeros_like(own_steps.survival)
    within = 1 - own_steps.first * other_steps.first
    for i in range(1, count):
        stayed = own_steps.survival[i] + own_steps.convolve(back, i)
        returned = other_steps.convolve(in_state, i) + other_steps.last[i]
        in_state[i] = (stayed + own_steps.first * returned) / np.maximum(within, 1e-12)
        back[i] = returned + other_steps.first * in_state[i]
    return np.clip(back, 0.0, 1.0)


class _StepEnds:
    """Probability that a duration ends within each step of the grid."""

    def __init__(self, half_steps: FloatArray) -> None:
        """Use the survival function (2 I - 1, N) at every half step."""
        self.survival = half_steps[::2]
        """(I, N) survival function at whole steps."""
        middles = half_steps[1::2]
        self.first = 1 - middles[0] if len(middles) else np.zeros_like(half_steps[0])
        """(N,) probability of an end within the first half step."""
        self._around = middles[:-1] - middles[1:]
        """(I - 2, N) probability of an end within half a step around 1, 2, ..."""
        self.last = np.concatenate([np.zeros_like(half_steps[:1]), middles - self.survival[1:]])
        """(I, N) probability of an end within the half step before 0, 1, ..."""

    def convolve(self, after: FloatArray, i: int) -> FloatArray:
        """Return (N,) the sum over lags 1 to i - 1 of the probability of an end at the lag times `after` at i - lag."""
        return np.einsum("jn,jn->n", self._around[: i - 1], after[i - 1 : 0 : -1])


_STEPS_AHEAD = 32
"""Number of steps of the time grid for predictions."""


@dataclass(frozen=True, slots=True)
class SightErrors:
    """Error rates of observations."""

    miss: float
    """P_M: probability that an observation misses a thing that is present; between 0 and 1."""
    false_alarm: float
    """P_F: probability that an observation reports a thing that is absent; between 0 and 1."""


@dataclass(frozen=True, slots=True, eq=False)
class PersistentFilter:
    """A persistence filter that switches to an emergence filter and back."""

    present: DurationMixture
    """Durations of presence."""
    absent: DurationMixture
    """Durations of absence."""
    errors: SightErrors
    present_at_first: float = 0.9
    """Prior probability that a thing is present, before the first observation."""
    switch_below: float = 0.05
    """Probability of a state below which the filter switches to the other state."""
    prior_stays: float = 2.0
    """Weight of the prior weights of the components, as a number of observed durations."""

    def follow(self, count: int) -> "PersistentTracks":
        """Start filters for several things."""
        return PersistentTracks(self, count)


class PersistentTracks:
    """State of the filter for N things and K components, in logarithms.

    For the current state of each thing, `stay` is ln of the likelihood of all observations since `since` if the state
    still lasts, and `left` (N, K) is ln of their probability if it ended before the last of them. State 1 is present,
    0 absent.
    """

    def __init__(self, config: PersistentFilter, count: int) -> None:
        """Start with the prior for `count` things."""
        absent, present = config.absent, config.present
        self._config = config
        self._scales = _for_things(count, absent.scales_s, present.scales_s, missing=1.0)
        self._shapes = _for_things(count, absent.shapes, present.shapes, missing=1.0)
        self._prior = _for_things(count, absent.weights, present.weights, missing=0.0)
        self._counts = np.zeros_like(self._prior)
        """(2, N, K) expected numbers of past durations of each component, by state."""
        self._weights = self._prior.copy()
        """(2, N, K) weights of the components for a new duration, by state."""
        self._state = np.ones(count, np.intp)
        self._since = np.full(count, np.nan)
        self._last = np.full(count, np.nan)
        self._stay = np.full(count, np.log(config.present_at_first))
        self._left = np.full(self._prior.shape[1:], np.log1p(-config.present_at_first))

    def observe(self, rows: Rows, present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Update with one observation of each of M different things, see `PresenceTracks`."""
        fresh = np.isnan(self._since[rows])
        self._since[rows[fresh]] = self._last[rows[fresh]] = stamps_s[fresh]
        self._cross_silence(rows, present, stamps_s)
        state = self._state[rows]
        errors = self._config.errors
        before = self._log_survival(rows, self._last[rows])
        ended = log_ended_between(before, self._log_survival(rows, stamps_s))
        agrees = present == (state == 1)
        missed = np.where(state == 1, errors.miss, errors.false_alarm)
        mistaken = np.where(state == 1, errors.false_alarm, errors.miss)
        left = np.logaddexp(self._left[rows], self._stay[rows, None] + ended)
        self._left[rows] = left + np.where(agrees, np.log(mistaken), np.log1p(-mistaken))[:, None]
        self._stay[rows] += np.where(agrees, np.log1p(-missed), np.log(missed))
        self._last[rows] = np.maximum(stamps_s, self._last[rows])
        self._switch(rows)

    def probability(self, at_s: float) -> FloatArray:
        """Return the probabilities (N,) that things are present at a moment; the prior for unobserved things."""
        everything = np.arange(len(self._state))
        same = np.full(len(everything), self._config.present_at_first)
        looked_for = everything[~np.isnan(self._last)]
        same[looked_for] = self._same_state(looked_for, np.maximum(at_s, self._last[looked_for]))
        return np.where(self._state == 1, same, 1 - same)

    def _cross_silence(self, rows: Rows, present: NDArray[np.bool_], stamps_s: FloatArray) -> None:
        """Restart the state of things that have most probably left it and come back since the last observation."""
        lasting = self._still(rows, stamps_s)
        silent = lasting < self._still(rows, self._last[rows]) - self._config.switch_below
        if not silent.any():
            return
        rows, present, stamps_s, lasting = rows[silent], present[silent], stamps_s[silent], lasting[silent]
        same = np.clip(self._same_state(rows, stamps_s), 1e-6, 1 - 1e-6)
        agrees = present == (self._state[rows] == 1)
        again = agrees & (same - lasting > lasting)
        self._learn(rows[again], stamps_s[again])
        self._restart(rows[again], stamps_s[again], same[again])

    def _switch(self, rows: Rows) -> None:
        """Switch things to the other state if the probability of the current one is too low."""
        still = self._still(rows, self._last[rows])
        over = still <= self._config.switch_below
        if not over.any():
            return
        rows, still = rows[over], still[over]
        self._learn(rows, self._last[rows])
        self._state[rows] = 1 - self._state[rows]
        self._restart(rows, self._last[rows], 1 - still)

    def _learn(self, rows: Rows, stamps_s: FloatArray) -> None:
        """Update the weights of the components with a duration that ended before a moment (M,)."""
        state = self._state[rows]
        prior_stays = self._config.prior_stays
        survival = self._log_survival(rows, self._last[rows])
        ended = self._stay[rows, None] + log_ended_between(survival, self._log_survival(rows, stamps_s))
        learned = np.log(np.maximum(self._weights[state, rows], 1e-300)) + np.logaddexp(self._left[rows], ended)
        learned = np.exp(learned - np.logaddexp.reduce(learned, axis=1, keepdims=True))
        self._counts[state, rows] += learned
        total = prior_stays + self._counts[state, rows].sum(axis=-1, keepdims=True)
        self._weights[state, rows] = (prior_stays * self._prior[state, rows] + self._counts[state, rows]) / total

    def _restart(self, rows: Rows, stamps_s: FloatArray, probability: FloatArray) -> None:
        """Restart the state at a moment, with the probability that it is the right one."""
        self._since[rows] = self._last[rows] = stamps_s
        self._stay[rows] = np.log(probability)
        self._left[rows] = np.log(np.maximum(1 - probability, 1e-12))[:, None]

    def _log_survival(self, rows: Rows, stamps_s: FloatArray) -> FloatArray:
        state = self._state[rows]
        ages = stamps_s - self._since[rows]
        return log_survival(ages[..., None], self._scales[state, rows], self._shapes[state, rows])

    def _still(self, rows: Rows, stamps_s: FloatArray) -> FloatArray:
        """Return the probability that the state lasts until moments (..., M) after the last observation."""
        weights = self._weights[self._state[rows], rows]
        stay = self._stay[rows, None]
        at_last = np.logaddexp(self._left[rows], stay + self._log_survival(rows, self._last[rows]))
        highest = at_last.max(axis=-1, keepdims=True)
        evidence = (weights * np.exp(at_last - highest)).sum(axis=-1)
        lasting = np.exp(stay + self._log_survival(rows, stamps_s) - highest)
        return (weights * lasting).sum(axis=-1) / evidence

    def _same_state(self, rows: Rows, stamps_s: FloatArray) -> FloatArray:
        """Return the probabilities (M,) that things are in the same state at moments (M,), even if they left it in
        between."""
        last = self._last[rows]
        ahead = np.maximum(stamps_s - last, 0.0)
        shares = np.linspace(0.0, 1.0, 2 * _STEPS_AHEAD + 1)[:, None]
        state = self._state[rows]
        own, other = (self._fresh_survival(each, rows, shares * ahead) for each in (state, 1 - state))
        back = return_probabilities(own, other)
        still = self._still(rows, last + shares[::2] * ahead)
        in_step = (back[:-1] + back[1:])[::-1] / 2
        returned = (1 - still[0]) * back[-1] + ((still[:-1] - still[1:]) * in_step).sum(axis=0)
        return np.clip(still[-1] + returned, 0.0, 1.0)

    def _fresh_survival(self, state: Rows, rows: Rows, ages_s: FloatArray) -> FloatArray:
        """Return the survival function (..., M) of a new duration at ages (..., M)."""
        lasting = np.exp(log_survival(ages_s[..., None], self._scales[state, rows], self._shapes[state, rows]))
        return (self._weights[state, rows] * lasting).sum(axis=-1)


def _for_things(count: int, *by_state: FloatArray, missing: float) -> FloatArray:
    """Return (2, N, K) values of the components of two mixtures, (K,) or (N, K), for each of N things."""
    found = np.full((len(by_state), count, max(values.shape[-1] for values in by_state)), missing)
    for state, values in enumerate(by_state):
        found[state, :, : values.shape[-1]] = values
    return found


_MINUTE_S = 60.0
_HOUR_S = 3600.0
_DAY_S = 86400.0

EDGE_ERRORS = SightErrors(miss=0.005, false_alarm=0.005)
"""Error rates for edges: low, because an obstruction must lie across the path, and a success is at its end."""

USUALLY_PRESENT = 0.9
"""Probability that an edge without observations is open."""

PERSISTENT = PersistentFilter(
    # The first obstruction of an edge is mostly a door, which is opened and closed many times a day.
    present=DurationMixture.exponential([30 * _MINUTE_S, 6 * _HOUR_S, 7 * _DAY_S], [0.4, 0.3, 0.3]),
    # A person passes, a door is closed for a while, or an object stays for hours.
    absent=DurationMixture.exponential([15.0, 10 * _MINUTE_S, 5 * _HOUR_S], [0.25, 0.4, 0.35]),
    errors=EDGE_ERRORS,
    present_at_first=USUALLY_PRESENT,
)
