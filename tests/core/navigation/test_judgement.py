"""Who says an attempt succeeded: the network, unless all that was seen on the way says otherwise."""

from operator import attrgetter

import numpy as np

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.navigation.arrival import is_at_goal
from ltvn_core.navigation.judgement import judge_attempt

THERE = np.array([0.1, 0.0, 0.0])


def verdict(
    method: Method = ROBUST, r: float = 0.9, d: float = 0.2, left: np.ndarray = THERE, **also: bool
) -> tuple[bool, str]:
    judged = judge_attempt(r, d, left, method, **also)
    assert attrgetter(judged.rule)(method) is not None
    return judged.succeeded, judged.reason


def test_a_near_and_reachable_target_is_a_success() -> None:
    assert verdict() == (True, "target is near: d = 0.20, r = 0.90")


def test_every_failure_names_its_rule() -> None:
    assert verdict(r=0.2) == (False, "target does not look reachable: r = 0.20, needs 0.50")
    assert verdict(d=0.9) == (False, "target is still too far: d = 0.90, needs 0.70")
    assert verdict(driven_too_often=True) == (False, "driven too often in this query")
    assert verdict(fits_place=False) == (False, "the images of the whole query say that the target is elsewhere")


def test_what_stands_in_the_way_or_goes_in_circles_says_little_about_the_edge() -> None:
    assert judge_attempt(0.2, 0.9, THERE, ROBUST, hindered=True).hindered
    assert judge_attempt(0.9, 0.2, THERE, ROBUST, driven_too_often=True).hindered
    assert not judge_attempt(0.9, 0.2, THERE, ROBUST, fits_place=False, hindered=True).hindered
    assert not judge_attempt(0.2, 0.9, THERE, ROBUST).hindered


def test_a_target_that_is_where_odometry_says_but_hard_to_recognise_says_little_about_the_edge() -> None:
    judged = judge_attempt(0.4, 0.1, THERE, ROBUST)
    assert (judged.succeeded, judged.hindered) == (False, True)
    assert not judge_attempt(0.4, 0.1, np.array([0.5, 0.0, 0.0]), ROBUST).hindered


def test_the_literal_method_asks_whether_the_target_is_connectable() -> None:
    assert verdict(PAPER, d=1.4).__getitem__(0)
    assert not verdict(PAPER, d=1.6)[0]
    assert not verdict(PAPER, r=0.7)[0]
    assert verdict(PAPER, left=np.array([2.0, 0, 0]))[0]


def test_the_goal_is_reached_near_reachable_and_facing_the_right_way() -> None:
    assert is_at_goal(0.9, np.array([0.2, 0.0, 0.1]), ROBUST.judging)
    assert not is_at_goal(0.5, np.array([0.2, 0.0, 0.1]), ROBUST.judging)
    assert not is_at_goal(0.9, np.array([0.6, 0.0, 0.0]), ROBUST.judging)
    assert not is_at_goal(0.9, np.array([0.0, 0.0, 0.33]), ROBUST.judging)
    assert is_at_goal(0.9, np.array([0.0, 0.0, 0.28]), PAPER.judging)
