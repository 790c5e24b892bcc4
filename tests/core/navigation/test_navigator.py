"""The whole loop in a flat world: it arrives, and tells how."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.evaluation.query_run import judge_goal_reached, random_goals
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Event,
    GraphChanged,
    Judged,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
    QueryStarted,
    StateChanged,
    Tick,
)
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, FlatRobot
from tests.core.navigation.mapped_world import FIRST_STEP, PRESETS, events_of, mapped_corridor, mapped_rooms


@PRESETS
def test_random_goals_in_two_rooms_are_reached(method: Method) -> None:
    place = mapped_rooms(method, drift=0.03)
    goals = random_goals(list(place.graph.nodes), 6, np.random.default_rng(1))
    navigator = place.navigator()
    reached = [place.go(goal, query, navigator)[0].reached for query, goal in enumerate(goals)]
    assert all(reached)
    assert place.robot.collisions == 0


def test_the_events_tell_the_story_in_order() -> None:
    place = mapped_rooms(ROBUST)
    goal = place.nearest(5.2, 3.2)
    episode, events = place.go(goal, query=7)
    assert events[0] == QueryStarted(7, goal)
    ended = events_of(QueryEnded, events)[0]
    assert (episode.query, episode.goal, episode.steps, episode.path_m) == (7, goal, ended.steps, ended.path_m)
    assert episode.outcome == Outcome.ARRIVED
    assert episode.position_error_m == events_of(Judged, events[-1:])[0].position_error_m
    kinds = [type(event) for event in events if not isinstance(event, StateChanged | GraphChanged)]
    for k, kind in enumerate(kinds):
        if kind is AttemptStarted:
            assert kinds[k - 2 : k] == [Localised, Planned]
            assert kinds[k + 1] is AttemptEnded
    legs = events_of(AttemptStarted, events)
    assert [started.attempt for started in legs] == list(range(1, len(legs) + 1))
    assert episode.steps == place.robot.step - FIRST_STEP
    assert episode.path_m > 3


def test_driving_to_a_goal_is_one_call() -> None:
    place, told = mapped_rooms(ROBUST), list[Event]()
    goal = place.nearest(5.2, 3.2)

    ended = place.navigator().drive_to(goal, query=7, consume=told.append)

    assert (ended.query, ended.goal, ended.outcome) == (7, goal, Outcome.ARRIVED)
    assert told[0] == QueryStarted(7, goal)
    assert told[-1] is ended
    assert place.robot.step - FIRST_STEP == ended.steps
    with pytest.raises(MapError, match="not in the map"):
        place.navigator().drive_to(-1)


def test_an_error_while_driving_to_a_goal_leaves_the_robot_standing() -> None:
    place = mapped_rooms(ROBUST)

    def fail(event: Event) -> None:
        if isinstance(event, AttemptStarted):
            raise TimeoutError

    with pytest.raises(TimeoutError):
        place.navigator().drive_to(place.nearest(5.2, 3.2), consume=fail)
    pose = place.robot.pose
    place.robot.advance()
    assert np.array_equal(place.robot.pose, pose)


def test_the_robot_backs_up_along_an_edge_driven_against_its_direction() -> None:
    place = mapped_corridor(replace(ROBUST, driving=replace(ROBUST.driving, back_up_clearance_m=0.0)))
    place.robot.pose = np.array([3.0, 1.0, 0.0])
    twists = []
    for event in place.navigator().query(1, 0):
        if isinstance(event, Tick):
            twists.append(place.robot.twist.linear_m_s)
            place.robot.advance()
    assert judge_goal_reached(0, place.robot.pose, place.poses[1]).reached
    assert min(twists) < 0
    assert max(twists) <= 0


def test_a_goal_that_is_not_in_the_map_is_refused_at_once() -> None:
    place = mapped_corridor(ROBUST)
    with pytest.raises(MapError, match="Node 77 is not in the map, which has 7 nodes"):
        place.navigator().query(77, 0)


def test_a_robot_that_starts_at_the_goal_has_arrived() -> None:
    place = mapped_corridor(ROBUST)
    episode, events = place.go(0)
    assert episode.reached
    assert events_of(AttemptStarted, events) == []


@PRESETS
def test_the_navigator_never_reads_the_exact_pose(method: Method) -> None:
    place = mapped_corridor(method)

    class Features(FlatPredictor):
        """Keeps the truth in its features and takes it from the images afterwards."""

        def encode(self, observations) -> np.ndarray:  # noqa: ANN001
            return np.array([[*place.robot.pose, seen.step] for seen in observations])

    class Blindfolded(FlatRobot):
        def observe(self) -> Observation:
            return replace(super().observe(), exact_pose=None)

    place.predictor = Features(place.world)
    place.robot = Blindfolded(place.world, [0.6, 1.0, 0.0], first_step=FIRST_STEP)
    assert place.go(4)[0].reached


def test_the_verdict_is_the_papers() -> None:
    goal = np.array([1.0, 1.0, 3.1])
    assert judge_goal_reached(0, np.array([1.5, 1.5, -3.1]), goal).reached  # 0.71 m, and the yaw wraps.
    assert not judge_goal_reached(0, np.array([1.52, 1.52, 3.1]), goal).reached
    assert not judge_goal_reached(0, np.array([1.0, 1.0, 2.6]), goal).reached
