"""Explains in words why a pair is not reachable: each failed criterion with the measured value and the limit."""

from dataclasses import dataclass, fields
from math import degrees

import numpy as np

from ltvn_core.structured_text import parse_json
from ltvn_core.training_data.pair_table import LabelledPair
from ltvn_core.training_data.reachability_labels import FailedCriteria, ReachabilityLimits


@dataclass(frozen=True, slots=True)
class FailureExplanation:
    """One failed criterion and its explanation."""

    criterion: FailedCriteria
    text: str

    @property
    def name(self) -> str:
        """Name of the criterion in lower case."""
        return criterion_name(self.criterion)


def criterion_name(criterion: FailedCriteria) -> str:
    """Return a criterion's name in lower case."""
    return (criterion.name or str(int(criterion))).lower()


def single_criteria() -> tuple[FailedCriteria, ...]:
    """Return all single criteria."""
    return tuple(each for each in FailedCriteria if each)


def reasons(pair: LabelledPair, limits: ReachabilityLimits) -> tuple[FailureExplanation, ...]:
    """Return an explanation for each criterion that the pair fails."""
    return tuple(
        FailureExplanation(each, _text(each, pair, limits)) for each in single_criteria() if each & pair.failed
    )


def limits_from_recipe(recipe: str) -> ReachabilityLimits:
    """Return the limits in a shard's recipe; the defaults where it has none."""
    try:
        found = parse_json(recipe)["limits"]
    except (ValueError, KeyError, TypeError):
        return ReachabilityLimits()
    known = {field.name for field in fields(ReachabilityLimits)}
    return ReachabilityLimits(**{name: float(value) for name, value in found.items() if name in known})


def _text(criterion: FailedCriteria, pair: LabelledPair, limits: ReachabilityLimits) -> str:
    match criterion:
        case FailedCriteria.DISTANCE:
            return f"{pair.distance_m:.2f} m apart, at most {limits.distance_m:.2f} m are allowed"
        case FailedCriteria.YAW:
            turn = abs(degrees(pair.waypoint[2]))
            most = degrees(limits.yaw_rad)
            return f"turned by {turn:.0f}°, at most {most:.0f}° are allowed"
        case FailedCriteria.VISIBILITY:
            return _visibility_text(pair)
        case FailedCriteria.OVERLAP:
            return (
                f"the source sees {pair.overlap:.0%} of the target's points, more than {limits.overlap:.0%} are needed"
            )
        case FailedCriteria.PATH:
            return _path_text(pair.path_ratio, limits.path_ratio)
        case FailedCriteria.LINE:
            return f"something stands within {limits.line_clearance_m:.2f} m of the straight way"
        case _:
            return "fails this criterion"


def _visibility_text(pair: LabelledPair) -> str:
    if pair.waypoint[0] <= 0:
        return "the target's place lies behind the source"
    return "the target's place is hidden or outside the image"


def _path_text(ratio: float, limit: float) -> str:
    if not np.isfinite(ratio):
        return f"the way is far longer than {limit:.2f} times the straight line"
    return f"the way is {ratio:.2f} times the straight line, at most {limit:.2f} are allowed"
