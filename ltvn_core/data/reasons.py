"""Why a pair is not reachable, in words: each failed criterion with the pair's number and the limit it breaks.

Owns the wording. The criteria and their limits are in `ltvn_core.data.labels`.
"""

import json
from dataclasses import dataclass, fields
from math import degrees

import numpy as np

from ltvn_core.data.labels import Failed, Limits
from ltvn_core.data.pair_table import LabelledPair


@dataclass(frozen=True, slots=True)
class Reason:
    """One failed criterion."""

    criterion: Failed
    text: str

    @property
    def name(self) -> str:
        """Return the criterion's name as people write it."""
        return name_of(self.criterion)


def name_of(criterion: Failed) -> str:
    """Return a criterion's name in lower case."""
    return (criterion.name or str(int(criterion))).lower()


def criteria() -> tuple[Failed, ...]:
    """Return all single criteria."""
    return tuple(each for each in Failed if each)


def reasons(pair: LabelledPair, limits: Limits) -> tuple[Reason, ...]:
    """Return a reason for each criterion that the pair fails."""
    return tuple(Reason(each, _text(each, pair, limits)) for each in criteria() if each & pair.failed)


def limits_of(recipe: str) -> Limits:
    """Return the limits that a shard's recipe names; ours where it names none."""
    try:
        found = json.loads(recipe)["limits"]
    except (ValueError, KeyError, TypeError):
        return Limits()
    known = {field.name for field in fields(Limits)}
    return Limits(**{name: float(value) for name, value in found.items() if name in known})


def _text(criterion: Failed, pair: LabelledPair, limits: Limits) -> str:
    match criterion:
        case Failed.DISTANCE:
            return f"{pair.distance_m:.2f} m apart, at most {limits.distance_m:.2f} m are allowed"
        case Failed.YAW:
            turn, most = abs(degrees(pair.waypoint[2])), degrees(limits.yaw_rad)
            return f"turned by {turn:.0f}°, at most {most:.0f}° are allowed"
        case Failed.VISIBILITY:
            return _hidden(pair)
        case Failed.OVERLAP:
            return (
                f"the source sees {pair.overlap:.0%} of the target's points, more than {limits.overlap:.0%} are needed"
            )
        case Failed.PATH:
            return _detour(pair.path_ratio, limits.path_ratio)
        case Failed.LINE:
            return f"something stands within {limits.line_clearance_m:.2f} m of the straight way"
        case _:
            return "fails this criterion"


def _hidden(pair: LabelledPair) -> str:
    if pair.waypoint[0] <= 0:
        return "the target's place lies behind the source"
    return "the target's place is hidden or beside the picture"


def _detour(ratio: float, limit: float) -> str:
    if not np.isfinite(ratio):
        return f"the way is far longer than {limit:.2f} times the straight line"
    return f"the way is {ratio:.2f} times the straight line, at most {limit:.2f} are allowed"
