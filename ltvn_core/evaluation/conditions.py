"""Conditions harder than the usual ones: what of the test each of them changes, for all systems alike.

Owns the numbers; the names are in `condition_names`.
"""

from collections.abc import Collection
from dataclasses import replace

from ltvn_core.evaluation.condition_names import CONDITION_NAMES
from ltvn_core.evaluation.protocol import USUAL_LOOPS, EvaluationProtocol
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light

_OF_THE_DRIVE = ("slip", "one-loop")
_SLIPPING = {"distance_noise": 0.05, "angle_noise": 0.03, "slips_per_m": 0.2}
"""2.5 and 3 times the usual noise, and a slip every five metres or radians (ours)."""
_HALF_LIGHT = Light.of(0.5, 0.0)


def protocol_under(protocol: EvaluationProtocol, conditions: Collection[str]) -> EvaluationProtocol:
    """Return the protocol as it is under some conditions."""
    if "slip" in conditions:
        protocol = replace(protocol, **_SLIPPING)
    return replace(protocol, loops=1) if "one-loop" in conditions else protocol


def light_under(conditions: Collection[str]) -> Light:
    """Return the light in which the episodes are driven."""
    return _HALF_LIGHT if "half-light" in conditions else PLAIN_LIGHT


def drive_conditions(conditions: Collection[str]) -> tuple[str, ...]:
    """Return those conditions under which the mapping drive is another one, in order."""
    return tuple(name for name in _OF_THE_DRIVE if name in conditions)


def episode_conditions(conditions: Collection[str]) -> tuple[str, ...]:
    """Return those that change the episodes alone, in order."""
    return tuple(name for name in CONDITION_NAMES if name in conditions and name not in _OF_THE_DRIVE)


def told_conditions(protocol: EvaluationProtocol, conditions: Collection[str]) -> tuple[str, ...]:
    """Return what tables name: the conditions in order, and another number of rounds than the usual one."""
    named = tuple(name for name in CONDITION_NAMES if name in conditions)
    usual = protocol.loops == USUAL_LOOPS or "one-loop" in named
    return named if usual else (*named, f"{protocol.loops} mapping loop{'s' if protocol.loops > 1 else ''}")
