"""A query always ends, at its limits or when somebody ends it, and always stops the robot."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import RobotPausedError
from ltvn_core.graph.deltas import Cause, NodeAdded, NodeDropped
from ltvn_core.navigation.events import (
    AttemptEnd,
    AttemptEnded,
    Collided,
    GraphChanged,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
    Tick,
)
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, FlatRobot
from tests.core.navigation.mapped_world import (
    FIRST_STEP,
    PRESETS,
    block_corridor,
    events_of,
    mapped_corridor,
    mapped_rooms,
)


@PRESETS
def test_where_no_path_exists_the_query_ends_and_says_so(method: Method) -> None:
    place = mapped_corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=5)))
    place.graph.apply(NodeDropped(3, Cause.HAND))
    episode, events = place.go(6)
    assert episode.outcome == Outcome.NO_PATH
    assert episode.steps < 200
    assert events_of(Planned, events)[0].nodes == ()
    assert events_of(Planned, events)[0].cost == math.inf


@PRESETS
def test_a_query_never_outlasts_its_limits(method: Method) -> None:
    limits = replace(method.recovering, step_limit=150, give_up_after_looks=10_000)
    place = mapped_corridor(replace(method, recovering=limits))
    place.graph.apply(NodeDropped(3, Cause.HAND))
    ticks, outcome = 0, None
    for event in place.navigator().query(6, 0):
        if isinstance(event, Tick):
            ticks += 1
            place.robot.advance()
            assert ticks <= 150
        outcome = event.outcome if isinstance(event, QueryEnded) else None
    assert outcome is Outcome.STEP_LIMIT


@PRESETS
def test_a_goal_that_only_seems_near_does_not_hold_the_robot_for_ever(method: Method) -> None:
    """A node that the network puts where the robot stands, but for the yaw, is a leg of no step for ever."""
    place = mapped_corridor(replace(method, recovering=replace(method.recovering, step_limit=300)))

    class Stuck(FlatPredictor):
        def predict(self, sources: np.ndarray, targets: np.ndarray):  # noqa: ANN202
            answer = super().predict(sources, targets)
            answer.reachability[:], answer.waypoints[:] = 0.55, np.array([0.01, 0.0, 0.01])
            return answer

    place.predictor = Stuck(place.world)
    events = []
    for event in place.navigator().query(6, 0):
        events.append(event)
        assert len(events) < 20_000
        if isinstance(event, Tick):
            place.robot.advance()
    assert isinstance(events[-1], QueryEnded)


class PausedRobot(FlatRobot):
    """A robot whose program is paused for a moment; it obeys again when it was stopped."""

    pauses = 3

    def observe(self) -> Observation:
        if self.pauses:
            raise RobotPausedError("This program did not run.")
        return super().observe()

    def stop(self) -> None:
        super().stop()
        self.pauses = max(0, self.pauses - 1)


def test_a_pause_of_the_program_stops_the_robot_but_not_the_query() -> None:
    place = mapped_corridor(ROBUST)
    place.robot = PausedRobot(place.world, [0.6, 1.0, 0.0], first_step=FIRST_STEP)
    episode, _ = place.go(4)
    assert episode.outcome == Outcome.ARRIVED


def test_too_many_collisions_end_the_query() -> None:
    recovering = replace(PAPER.recovering, collision_limit=3)
    place = mapped_corridor(replace(PAPER, recovering=recovering, maintain=False))
    block_corridor(place)
    episode, events = place.go(5)
    assert episode.outcome == Outcome.COLLISION_LIMIT
    assert [event.count for event in events_of(Collided, events)] == [1, 2, 3, 4]


@pytest.mark.slow
def test_the_depth_image_stops_the_robot_before_it_collides() -> None:
    place = mapped_corridor(replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=100)))
    wall_x = 2.1

    class Seeing(FlatRobot):
        def observe(self) -> Observation:
            seen, away = super().observe(), (wall_x - self.pose[0]) / max(math.cos(self.pose[2]), 0.05)
            depth = np.full((72, 96), max(0.05, away) if abs(self.pose[2]) < 1.2 else 5.0, np.float32)
            return replace(seen, depth=depth)

    place.robot = Seeing(place.world, [0.6, 1.0, 0.0], first_step=FIRST_STEP)
    block_corridor(place)
    _, events = place.go(5)
    assert place.robot.collisions == 0
    assert AttemptEnd.BLOCKED in {ended.end for ended in events_of(AttemptEnded, events)}
    assert place.robot.pose[0] < wall_x - 0.18


@pytest.mark.parametrize("ticks", [0, 1, 40])
def test_closing_a_query_stops_the_robot(ticks: int) -> None:
    place = mapped_rooms(ROBUST)
    events = place.navigator().query(place.nearest(5.2, 3.2), 0)
    for event in events:
        if isinstance(event, Tick):
            place.robot.advance()
            ticks -= 1
        if ticks < 0:
            break
    stops = place.robot.stops
    events.close()  # type: ignore[attr-defined]
    assert place.robot.stops > stops
    assert place.robot.twist == (0.0, 0.0)
    assert list(events) == []


def test_a_failing_camera_stops_the_robot() -> None:
    place = mapped_rooms(ROBUST)
    events = place.navigator().query(place.nearest(5.2, 3.2), 0)

    def broken() -> Observation:
        raise OSError("camera unplugged")

    def until_the_camera_fails() -> None:
        for count, event in enumerate(events):
            if isinstance(event, Tick):
                place.robot.advance()
            if count == 30:
                place.robot.observe = broken  # type: ignore[method-assign]

    with pytest.raises(OSError, match="unplugged"):
        until_the_camera_fails()
    assert place.robot.twist == (0.0, 0.0)


def test_a_cancelled_query_ends_with_its_events() -> None:
    place = mapped_rooms(ROBUST)
    navigator = place.navigator()
    events = []
    for event in navigator.query(place.nearest(5.2, 3.2), 0):
        events.append(event)
        if isinstance(event, Tick):
            place.robot.advance()
        if len(events) == 30:
            navigator.cancel()
    assert isinstance(events[-1], QueryEnded)
    assert events[-1].outcome is Outcome.CANCELLED
    assert len(events) < 40
    assert events_of(AttemptEnded, events)[-1].end is AttemptEnd.CANCELLED
    navigator.cancel()  # Between queries there is nothing to cancel.
    assert place.go(place.nearest(0.8, 0.8), 1, navigator)[0].reached


@PRESETS
def test_a_lost_robot_turns_looks_and_gives_up(method: Method) -> None:
    place = mapped_corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=8)))
    place.robot.pose = np.array([2.0, 3.5, math.pi / 2])
    place.predictor.sight_m = 0.3
    episode, events = place.go(6)
    assert episode.outcome == Outcome.LOST
    assert all(event.node is None for event in events_of(Localised, events))
    assert abs(place.robot.pose[2] - math.pi / 2) > 0.1


def test_a_lost_robot_that_turns_far_enough_finds_itself() -> None:
    place = mapped_corridor(ROBUST)
    place.robot.pose = np.array([0.7, 1.0, math.pi])
    assert place.go(4)[0].reached


def test_what_a_lost_robot_sees_becomes_a_node() -> None:
    place = mapped_corridor(PAPER)
    place.robot.pose = np.array([0.6, 1.0, 0.9])
    place.method = replace(PAPER, localising=replace(PAPER.localising, distance=0.5))
    place.method = replace(place.method, building=replace(PAPER.building, connect_distance=1.2))
    episode, events = place.go(4)
    added = [event.delta for event in events_of(GraphChanged, events) if isinstance(event.delta, NodeAdded)]
    assert added
    assert added[0].cause is Cause.NOVEL
    assert added[0].node.id in place.graph.nodes
    assert added[0].node.id in place.keyframes
    assert episode.reached
