"""Did the attempt succeed, is this the goal: verdicts with their reasons, as pure functions.

Owns the rules. The network that made a false edge also says "arrived" at its end, so the robust rules ask for evidence
of another kind: how far odometry went, and whether the edge was driven too often already.
"""

from typing import NamedTuple

import numpy as np

from ltvn_core.config import JudgingConfig, Method
from ltvn_core.geometry import distance, relative
from ltvn_core.types import Pose, Waypoint


class AttemptVerdict(NamedTuple):
    """Whether an attempt succeeded, and which rule decided."""

    succeeded: bool
    reason: str
    hindered: bool = False
    """It failed, but that says little about the edge."""


def judge_attempt(
    reachability: float,
    target_distance: float,
    odometry_error: Waypoint,
    method: Method,
    *,
    fits_trail: bool = True,
    hindered: bool = False,
    driven_too_often: bool = False,
) -> AttemptVerdict:
    """Judge an attempt by its target seen from the arrival image, and by where odometry puts the waypoint (3,).

    `fits_trail`: the target may be there after all that was seen on the way. `hindered`: something stood in the way.
    `driven_too_often`: the robot drove here too often to be getting anywhere.
    """
    judging = method.judging
    within = judging.success_distance or method.building.connect_distance
    needed = judging.success_reachability if judging.success_distance else method.building.connect_reachability
    gap = float(distance(odometry_error))
    if reachability <= needed:
        # Where it looks as near as odometry says, the target is probably there and merely hard to recognise.
        at_target = max(target_distance, gap) < _AT_TARGET_DISTANCE
        why = f"target does not look reachable: r = {reachability:.2f}, needs {needed:.2f}"
        return AttemptVerdict(False, why, hindered or at_target)
    if target_distance >= within:
        return AttemptVerdict(
            False, f"target is still too far: d = {target_distance:.2f}, needs {within:.2f}", hindered
        )
    if 0 < judging.odometry_gap < gap:
        why = f"odometry ended {gap:.2f} from the waypoint, at most {judging.odometry_gap:.2f}"
        return AttemptVerdict(False, why, hindered)
    if not fits_trail:
        return AttemptVerdict(False, "what was seen on the way does not fit the target")
    if driven_too_often:
        return AttemptVerdict(False, "driven too often in this query", hindered=True)
    return AttemptVerdict(True, f"target is near: d = {target_distance:.2f}, r = {reachability:.2f}")


def is_at_goal(reachability: float, waypoint: Waypoint, config: JudgingConfig) -> bool:
    """Tell whether the goal at `waypoint` (3,) is reached."""
    return bool(
        reachability > config.arrive_reachability
        and distance(waypoint) < config.arrive_distance
        and abs(waypoint[2]) <= config.arrive_yaw_rad
    )


def goal_estimates_agree(first: Waypoint, first_odometry: Pose, second: Waypoint, second_odometry: Pose) -> bool:
    """Tell whether two observations from two odometry poses (3,) put the goal at one place."""
    # The goal seen from the first place, as it must look from the second.
    moved = relative(first_odometry, second_odometry)
    gap = relative(relative(moved, first), second)
    return bool(np.hypot(gap[0], gap[1]) < _AGREE_M and abs(gap[2]) < _AGREE_RAD)


_AT_TARGET_DISTANCE = 0.3
"""A target nearer than this d is here."""
_AGREE_M = 0.3
_AGREE_RAD = 0.25
