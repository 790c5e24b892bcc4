"""Doors that close and open while a robot navigates, and what else may stand in its way."""

import itertools

import pytest

from ltvn_core.config import ROBUST
from ltvn_core.evaluation.worlds.world_truth import KnownPresence
from ltvn_core.graph.deltas import BeliefUpdated, Cause, PresenceObserved
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.navigation.events import AttemptStarted, Event, GraphChanged, Outcome, Planned, QueryEnded, StateChanged
from ltvn_core.systems.maintenance import with_maintenance
from tests.core.navigation.mapped_world import events_of
from tests.core.navigation.sighted_world import FAR_DOOR, NEAR_DOOR, DoorWorld, door_world


def drive(place: DoorWorld, query: int, *, after_s: float = 0.0) -> list[Event]:
    """Go from one room into the other, the near door being by far the shorter way."""
    place.wait(after_s)
    place.put(0.8, 1.0)
    episode, events = place.go(place.nearest(5.2, 1.0), query)
    assert episode.reached
    return events


def observed(events: list[Event]) -> list[PresenceObserved]:
    return [each.delta for each in events_of(GraphChanged, events) if isinstance(each.delta, PresenceObserved)]


def looks(events: list[Event]) -> int:
    """Count how often the way was found closed: things that are seen at one moment are one."""
    return len({each.stamp for each in observed(events) if not each.present})


def planned(events: list[Event]) -> set[tuple[int, int]]:
    return {edge for each in events_of(Planned, events) for edge in itertools.pairwise(each.nodes)}


def tried(events: list[Event]) -> set[tuple[int | None, int]]:
    return {(each.source, each.target) for each in events_of(AttemptStarted, events)}


def steps(events: list[Event]) -> int:
    return sum(each.steps for each in events_of(QueryEnded, events))


def through_near_door(place: DoorWorld) -> set[tuple[int, int]]:
    """Return the edges whose straight ways lead through the near door, by the truth."""
    found = set()
    for source, target in place.graph.edges:
        (x, y), (u, v) = place.poses[source][:2], place.poses[target][:2]
        if (x - 3) * (u - 3) < 0 and 0.5 < y + (3 - x) / (u - x) * (v - y) < 1.5:
            found.add((source, target))
    return found


def test_a_door_that_closes_is_gone_round_looked_at_again_and_used_when_it_is_open() -> None:
    place = door_world()
    direct = steps(drive(place, 0))
    edges = set(place.graph.edges)
    place.change(NEAR_DOOR)
    first = drive(place, 1)
    closed = [each for each in observed(first) if not each.present]
    begun_s = min(each.stamp for each in closed)
    assert {(each.source, each.target) for each in closed if each.stamp < begun_s + 1} == through_near_door(place)
    assert looks(first) == 2  # The second time from the other room.
    assert set(place.graph.presence) == through_near_door(place)
    assert steps(first) > direct
    assert looks(drive(place, 2, after_s=600)) == 1  # It may have been somebody who stood there.
    assert not planned(drive(place, 3, after_s=60)) & through_near_door(place)
    place.change()
    again = drive(place, 4, after_s=7200)
    assert steps(again) == direct
    assert {each.present for each in observed(again)} == {True}
    assert {(each.source, each.target) for each in observed(again)} == through_near_door(place)
    assert steps(drive(place, 5)) == direct
    assert set(place.graph.edges) == edges


def test_a_door_that_is_seen_to_be_closed_is_not_tried() -> None:
    place = door_world()
    place.change(NEAR_DOOR)
    assert not tried(drive(place, 0)) & through_near_door(place)


def test_a_door_that_is_hit_when_backing_up_is_tried_once_more_at_most() -> None:
    place = door_world()
    place.change(NEAR_DOOR)
    place.put(3.8, 1.0)
    _, events = place.go(place.nearest(2.2, 1.0), 0)
    attempts = [(each.source, each.target) for each in events_of(AttemptStarted, events)]
    through = through_near_door(place)
    assert sum(edge in through for edge in attempts) <= 2  # Who backs up has not seen it.
    assert set(place.graph.presence) <= through
    assert len(place.graph.presence) > 0.9 * len(through)


def test_what_no_image_shows_is_gone_round_once_it_has_stopped_the_robot_twice() -> None:
    place = door_world()
    place.put_glass(NEAR_DOOR)
    events = drive(place, 0)
    attempts = [(each.source, each.target) for each in events_of(AttemptStarted, events)]
    stopped_at = {edge: attempts.count(edge) for edge in attempts if edge in through_near_door(place)}
    assert max(stopped_at.values()) <= 2
    assert {(each.source, each.target) for each in observed(events)} <= through_near_door(place)
    assert looks(events)
    assert len(stopped_at) < len(attempts)


def test_where_all_ways_are_closed_the_robot_looks_round_and_tries_again() -> None:
    place = door_world()
    place.put_glass(NEAR_DOOR, FAR_DOOR, breaks_after_steps=800)
    assert steps(drive(place, 0)) > 800


def test_a_door_that_is_seen_to_be_open_again_from_afar_needs_no_try() -> None:
    place = door_world()
    place.change(NEAR_DOOR)
    drive(place, 0)
    place.change()
    place.put(0.8, 1.0)
    _, events = place.go(place.nearest(1.6, 1.0), 1)
    assert not tried(events) & through_near_door(place)
    assert {(each.source, each.target) for each in observed(events) if each.present} == through_near_door(place)


def test_the_ways_to_a_goal_are_never_given_up() -> None:
    place = door_world()
    goal = place.nearest(2.2, 1.0)
    for source in place.graph.predecessors(goal):
        place.graph.apply(PresenceObserved(source, goal, present=False, stamp=0.0, cause=Cause.SIGHT))
    place.put(0.8, 1.0)
    episode, events = place.go(goal, 0)
    assert episode.reached
    assert all(each.nodes for each in events_of(Planned, events))


def test_somebody_who_stood_in_the_door_for_a_moment_closes_it_for_a_moment() -> None:
    place = door_world()
    direct = steps(drive(place, 0))
    place.change([[2.9, 0.8], [2.9, 1.2]])
    assert looks(drive(place, 1)) == 1
    place.change()
    assert steps(drive(place, 2, after_s=60)) == direct


def test_what_stands_beside_the_way_closes_nothing() -> None:
    place = door_world()
    place.change([[2.6, 0.55], [2.6, 0.7]], [[1.5, 1.35], [1.9, 1.35]])
    drive(place, 0)
    assert not place.graph.presence


def test_drift_of_odometry_does_not_close_other_edges() -> None:
    place = door_world(drift=0.06)
    place.change(NEAR_DOOR)
    drive(place, 0)
    assert set(place.graph.presence) == through_near_door(place)


def test_a_robot_that_is_lost_observes_no_presence() -> None:
    place = door_world()
    place.predictor.sight_m = 0.0
    place.put(0.8, 1.0)
    episode, events = place.go(place.nearest(5.2, 1.0), 0)
    assert episode.outcome == Outcome.LOST
    assert not observed(events)


def test_where_nothing_ever_stood_in_the_way_presence_changes_no_plan_and_no_map() -> None:
    stories = []
    for name in ("robust", "persistent"):
        place = door_world(name)
        story: list[Event] = []
        for query, goal in enumerate([(3.8, 1.0), (3.8, 3.3)]):
            story += place.go(place.nearest(*goal), query)[1]
        stories.append([each for each in story if not isinstance(each, StateChanged)])
        assert any(isinstance(each.delta, BeliefUpdated) for each in events_of(GraphChanged, story))
    assert stories[0] == stories[1]


def test_who_knows_the_truth_never_tries_a_closed_door() -> None:
    place = door_world()
    direct = steps(drive(place, 0))
    doors = through_near_door(place)
    closed = set(doors)
    place.system = with_maintenance(ltvn_system(ROBUST), "truth", truth=KnownPresence(lambda graph: closed))
    place.change(NEAR_DOOR)
    assert looks(drive(place, 1)) == 0
    place.change()
    closed.clear()
    assert steps(drive(place, 2)) == pytest.approx(direct, abs=3)
