"""Who met whom, how near they came, and whose fault a touch was."""

import numpy as np
import pytest

from ltvn_core.evaluation.encounters import EncounterLog, count_encounters
from ltvn_core.evaluation.query_result import EncounterCounts
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Twist
from ltvn_core.worlds import PersonMoved

OPEN = ClearanceMap(np.pad(np.zeros((160, 160), bool), 1, constant_values=True), np.array([-4.05, -4.05]))
TOUCHING_M = LOCOBOT.radius_m + PERSON_RADIUS_M


def drive(yaw: float, speed_m_s: float, until_m: float, *, stepping_aside: tuple[str, ...] = ()) -> EncounterLog:
    """Drive from the origin along x, looking along `yaw`, until so far before a person who stands 3 m away."""
    log, person = EncounterLog(), PersonMoved("Ada", (3.0, 0.0, 0.0))
    for step, x in enumerate(np.linspace(0.0, 3.0 - until_m, 50)):
        log.take(step / 10, np.array([x, 0.0, yaw]), Twist(speed_m_s, 0.0), (person,), OPEN, stepping_aside)
    return log


def test_an_encounter_begins_near_and_knows_the_least_distance() -> None:
    assert drive(0.0, 0.5, 2.5).finish() == []
    (encounter,) = drive(0.0, 0.5, 1.0).finish()
    assert encounter.closest_m == pytest.approx(1.0 - TOUCHING_M, abs=0.001)
    assert not encounter.touched


@pytest.mark.parametrize(
    ("yaw", "speed_m_s", "avoidable"),
    [(0.0, 0.5, True), (np.pi, -0.5, True), (1.5, 0.5, False)],
    ids=["ahead and in view", "backwards and blindly", "aside of what the camera sees"],
)
def test_a_touch_is_held_against_who_could_have_seen_it(yaw: float, speed_m_s: float, avoidable: bool) -> None:
    (encounter,) = drive(yaw, speed_m_s, TOUCHING_M - 0.02).finish()
    assert encounter.touched
    assert encounter.avoidable is avoidable


def test_counts_add_up() -> None:
    met = count_encounters(drive(0.0, 0.5, 1.0, stepping_aside=("Ada",)).finish())
    touched = count_encounters(drive(0.0, 0.5, TOUCHING_M - 0.02).finish())
    assert (met.encounters, met.gave_way, met.touched, met.avoidable) == (1, 1, 0, 0)
    total = met + touched + EncounterCounts()
    assert (total.encounters, total.gave_way, total.touched, total.avoidable) == (2, 1, 1, 1)
    assert total.closest_m == touched.closest_m
    assert total.closest_each_m == (*met.closest_each_m, *touched.closest_each_m)


def approach(bearings: list[float], speed_m_s: float) -> bool:
    """Return whether the touch of a person, who is at these bearings at each step, is held against the robot."""
    log = EncounterLog()
    for step, bearing in enumerate(bearings):
        away_m = TOUCHING_M - 0.02 if step == len(bearings) - 1 else TOUCHING_M + 0.5
        place = (away_m * np.cos(bearing), away_m * np.sin(bearing), 0.0)
        log.take(step / 10, np.zeros(3), Twist(speed_m_s, 0.0), (PersonMoved("Ada", place),), OPEN)
    (encounter,) = log.finish()
    assert encounter.touched
    return encounter.avoidable


AHEAD, ASIDE = 0.2, 1.4


@pytest.mark.parametrize(
    ("bearings", "speed_m_s", "avoidable"),
    [
        ([AHEAD] * 5 + [ASIDE] * 20, 0.3, True),
        ([AHEAD] * 5 + [ASIDE] * 40, 0.3, False),
        ([ASIDE] * 20 + [AHEAD], 0.3, False),
        ([AHEAD] * 20, 0.0, False),
        ([ASIDE + 0.4] * 20, 0.3, False),
    ],
    ids=[
        "seen two seconds ago",
        "seen long ago",
        "seen too late to brake",
        "the robot stands",
        "the robot drives away",
    ],
)
def test_a_driver_is_to_remember_whom_it_saw_and_not_to_foresee_whom_it_could_not(
    bearings: list[float], speed_m_s: float, avoidable: bool
) -> None:
    assert approach(bearings, speed_m_s) is avoidable
