"""Verdicts about attempts, with their reasons.

The network that created a false edge also accepts the end of it. The robust method therefore needs independent
evidence: the place belief, which uses all images on the way. Owns the rules.
"""

from typing import NamedTuple

from ltvn_core.config import Method
from ltvn_core.geometry import distance
from ltvn_core.navigation.events import BY_PLACE
from ltvn_core.types import Waypoint

_SUCCESS_DISTANCE, _SUCCESS_REACHABILITY = "judging.success_distance", "judging.success_reachability"
_AT_TARGET_DISTANCE = 0.3
"""Distance d below which the robot is at the target."""


class AttemptVerdict(NamedTuple):
    """Whether an attempt succeeded, and which rule decided."""

    succeeded: bool
    reason: str
    hindered: bool = False
    """Whether the attempt failed for a reason that says little about the edge."""
    rule: str = ""
    """Name of the rule in `config`; empty if it has none."""


def judge_attempt(
    reachability: float,
    target_distance: float,
    odometry_error: Waypoint,
    method: Method,
    *,
    fits_place: bool = True,
    hindered: bool = False,
    driven_too_often: bool = False,
) -> AttemptVerdict:
    """Judge an attempt by the arrival image o_d: it succeeded if the target is reachable and near.

    `odometry_error`: (3,) rest of the waypoint by odometry. `fits_place`: the place belief does not exclude the target.
    `hindered`: an obstacle, a collision or the step limit ended the attempt. `driven_too_often`: the attempts along the
    edge exceed their limit in this query.
    """
    judging = method.judging
    within = judging.success_distance or method.building.connect_distance
    needed = judging.success_reachability if judging.success_distance else method.building.connect_reachability
    if reachability <= needed:
        # If image and odometry both place the target here, it is probably here and only hard to recognise.
        at_target = max(target_distance, float(distance(odometry_error))) < _AT_TARGET_DISTANCE
        why = f"target does not look reachable: r = {reachability:.2f}, needs {needed:.2f}"
        return AttemptVerdict(False, why, hindered or at_target, rule=_SUCCESS_REACHABILITY)
    if target_distance >= within:
        why = f"target is still too far: d = {target_distance:.2f}, needs {within:.2f}"
        return AttemptVerdict(False, why, hindered, rule=_SUCCESS_DISTANCE)
    if not fits_place:
        why = "the images of the whole query say that the target is elsewhere"
        return AttemptVerdict(False, why, rule=BY_PLACE)
    if driven_too_often:
        return AttemptVerdict(False, "driven too often in this query", hindered=True, rule="planning.repeat_limit")
    why = f"target is near: d = {target_distance:.2f}, r = {reachability:.2f}"
    return AttemptVerdict(True, why, rule=_SUCCESS_DISTANCE)
