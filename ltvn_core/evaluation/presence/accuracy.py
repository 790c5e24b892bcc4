"""Filters of presence compared on recorded sequences: fitted on one recording, judged on another.

Owns the moments that are judged and the figures. The filters are in `graph.presence`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.presence.filter_fit import FittedFilter
from ltvn_core.evaluation.presence.sequences import PresenceSequence
from ltvn_core.graph.presence.presence_filter import PresenceTracks
from ltvn_core.network.metrics.reachability_metrics import calibration_error

FloatArray = NDArray[np.float64]

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
    p, truth = said.ravel(), present.ravel()
    told_present = p >= 0.5
    rights = [float((told_present == truth)[truth == each].mean()) for each in (True, False) if (truth == each).any()]
    return PresenceAccuracy(
        brier=float(((p - truth) ** 2).mean()),
        balanced_accuracy=float(np.mean(rights)),
        ece=calibration_error(p, truth),
        moments=len(p),
    )
