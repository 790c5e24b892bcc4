"""How well filters of presence foretell when things are there, on recorded sequences with truth.

A filter gets the constants that suit the looks of one recording, without any truth, and is judged on another. Owns the
format of these recordings, how the lengths of stays are found and fitted, the moments that are judged, and the simplest
filter to compare with, the last look. The filters are in `graph.presence`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import OptionError
from ltvn_core.graph.presence.presence_filter import (
    DurationMixture,
    PersistentFilter,
    PresenceFilter,
    PresenceTracks,
    SightErrors,
)
from ltvn_core.network.metrics import calibration_error

FloatArray = NDArray[np.float64]

_KEYS = ("obs", "obs_t", "gt_obs", "gt_t")


@dataclass(frozen=True, slots=True, eq=False)
class PresenceSequence:
    """When one thing was looked for and found, and when it was really there."""

    name: str
    found: NDArray[np.bool_]
    """(L,) what each look said."""
    looked_at_s: FloatArray
    """(L,) times of the looks, increasing."""
    present: NDArray[np.bool_]
    """(G,) truth."""
    known_at_s: FloatArray
    """(G,) its times, increasing."""

    def truth_at(self, at_s: FloatArray) -> NDArray[np.bool_]:
        """Return (T,) whether the thing was there at times (T,): the truth known last."""
        return self.present[np.maximum(np.searchsorted(self.known_at_s, at_s, side="right") - 1, 0)]


def read_sequences(path: Path) -> tuple[PresenceSequence, ...]:
    """Read the things of an npz file, which has four arrays for each thing, such as `3.obs`, `3.obs_t`, `3.gt_obs`
    and `3.gt_t`: looks (0 or 1), their times in s, truth and its times in s.

    Raises OptionError where the file is missing or is of another kind.
    """
    try:
        with np.load(path) as arrays:
            names = sorted({key.partition(".")[0] for key in arrays.files})
            things = tuple(_sequence(path, name, [arrays[f"{name}.{key}"] for key in _KEYS]) for name in names)
    except (OSError, ValueError, KeyError) as error:
        raise OptionError(
            f"{path} is no file of presence ({error}); it must be an npz with arrays N.obs, N.obs_t, N.gt_obs and "
            "N.gt_t for each thing N."
        ) from None
    if not things:
        raise OptionError(f"{path} holds no things; each needs four arrays such as 0.obs, 0.obs_t, 0.gt_obs, 0.gt_t.")
    return things


def _sequence(path: Path, name: str, arrays: list[NDArray[np.generic]]) -> PresenceSequence:
    found, looked_at_s, present, known_at_s = (np.asarray(each, np.float64) for each in arrays)
    for values, times in ((found, looked_at_s), (present, known_at_s)):
        in_order = np.isfinite(times).all() and bool((np.diff(times) > 0).all())
        if values.ndim != 1 or values.shape != times.shape or not len(values) or not in_order:
            raise OptionError(f"{path}: thing {name} needs one value for each time, and times that increase.")
        if not np.isin(values, (0, 1)).all():
            raise OptionError(f"{path}: thing {name} has values other than 0 and 1; 1 means that it was there.")
    return PresenceSequence(
        name=name,
        found=found > 0,
        looked_at_s=looked_at_s,
        present=present > 0,
        known_at_s=known_at_s,
    )


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
    present = likeliest_states(sequence, errors)
    times = sequence.looked_at_s
    changes = np.flatnonzero(present[1:] != present[:-1]) + 1
    lengths = np.diff(times[changes])
    kinds = present[changes[:-1]]
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


JUDGED_EVERY_S = 10.0
"""Seconds between two moments that are judged."""


@dataclass(frozen=True, slots=True)
class PresenceAccuracy:
    """How well a filter told when things are there."""

    brier: float
    """Mean squared error of the probability; 0 is perfect."""
    balanced_accuracy: float
    """Mean of the shares of present and of absent moments that were told right, of all things together."""
    ece: float
    """Mean difference between probability and frequency, over ten bins of equal width."""
    moments: int


@dataclass(frozen=True, slots=True)
class FilterAccuracy:
    """A filter, now and ahead."""

    name: str
    now: PresenceAccuracy
    ahead: PresenceAccuracy


@dataclass(frozen=True, slots=True, eq=False)
class _Foretold:
    """What a filter said of N things at T moments."""

    now: FloatArray
    """(T, N)."""
    ahead: FloatArray
    """(T, N)."""


def filter_accuracy(fitted: FittedFilter, things: Sequence[PresenceSequence], *, ahead_s: float) -> FilterAccuracy:
    """Return how well a filter tells the presence of the things it was fitted for, now and `ahead_s` later.

    Raises OptionError where the things are not as many, or were not watched for so long.
    """
    begin = max(float(thing.looked_at_s[0]) for thing in things)
    end = min(float(thing.known_at_s[-1]) for thing in things) - ahead_s
    if end <= begin or len(things) != fitted.things:
        raise OptionError(
            f"The filter was fitted to {fitted.things} things and is to be judged on {len(things)}, of which "
            f"{end - begin:.0f} s can be judged; give recordings of the same things, longer than the time ahead."
        )
    moments = np.arange(begin, end, JUDGED_EVERY_S)
    now, later = (np.stack([thing.truth_at(at) for thing in things], axis=1) for at in (moments, moments + ahead_s))
    said = _foretell(fitted, things, moments, ahead_s)
    return FilterAccuracy(fitted.name, _accuracy(said.now, now), _accuracy(said.ahead, later))


def _foretell(
    fitted: FittedFilter, things: Sequence[PresenceSequence], moments: FloatArray, ahead_s: float
) -> _Foretold:
    """Hand a filter all looks in order, and ask it at each moment."""
    tracks = fitted.presence_filter.follow(len(things))
    said = _Foretold(*np.empty((2, len(moments), len(things))))
    times = np.unique(np.concatenate([thing.looked_at_s for thing in things]))
    next_look = 0
    for k, moment in enumerate(moments):
        while next_look < len(times) and times[next_look] <= moment:
            _observe(tracks, things, times[next_look])
            next_look += 1
        said.now[k] = tracks.probability(float(moment))
        said.ahead[k] = tracks.probability(float(moment + ahead_s))
    return said


def _observe(tracks: PresenceTracks, things: Sequence[PresenceSequence], at_s: float) -> None:
    places = [int(np.searchsorted(thing.looked_at_s, at_s)) for thing in things]
    rows = [
        row
        for row, (thing, place) in enumerate(zip(things, places, strict=True))
        if place < len(thing.looked_at_s) and thing.looked_at_s[place] == at_s
    ]
    found = np.array([things[row].found[places[row]] for row in rows])
    tracks.observe(np.array(rows, np.intp), found, np.full(len(rows), at_s))


def _accuracy(said: FloatArray, present: NDArray[np.bool_]) -> PresenceAccuracy:
    p = said.ravel()
    truth = present.ravel()
    told_present = p >= 0.5
    rights = [float((told_present == truth)[truth == each].mean()) for each in (True, False) if (truth == each).any()]
    return PresenceAccuracy(
        brier=float(((p - truth) ** 2).mean()),
        balanced_accuracy=float(np.mean(rights)),
        ece=calibration_error(p, truth),
        moments=len(p),
    )
