"""What driving teaches the map: beliefs, pruned edges, edges from the reserve, and whole runs of queries."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.evaluation.query_run import judge_goal_reached, random_goals, run_queries
from ltvn_core.graph.deltas import Cause, EdgeAdded, EdgePruned
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Event, GraphChanged
from tests.core.navigation.mapped_world import (
    FIRST_STEP,
    PRESETS,
    MappedWorld,
    block_corridor,
    events_of,
    join_nodes,
    mapped_corridor,
    mapped_rooms,
)


def test_what_was_driven_is_believed_more() -> None:
    place = mapped_corridor(ROBUST)
    before = dict(place.graph.edges)
    _, events = place.go(4)
    driven = [
        (ended.source, ended.target)
        for ended in events_of(AttemptEnded, events)
        if ended.source is not None and ended.succeeded
    ]
    assert driven
    for edge in driven:
        assert place.graph.edges[edge].belief.p > before[edge].belief.p
        assert place.graph.edges[edge].successes == 1


def test_every_change_of_the_map_is_told() -> None:
    place = mapped_rooms(ROBUST)
    start, history = place.graph.copy(), []
    navigator = place.navigator()
    for query, goal in enumerate(random_goals(list(place.graph.nodes), 4, np.random.default_rng(2))):
        history += [event.delta for event in events_of(GraphChanged, place.go(goal, query, navigator)[1])]
    for delta in history:
        start.apply(delta)
    assert start == place.graph


@PRESETS
def test_a_frozen_map_stays_as_it_is(method: Method) -> None:
    place = mapped_rooms(replace(method, maintain=False))
    before = place.graph.copy()
    episode, _ = place.go(place.nearest(5.2, 3.2))
    assert episode.reached
    assert place.graph == before


def drive_at_the_wall(method: Method, queries: int = 5) -> MappedWorld:
    """Send the robot along a corridor that a wall has closed, again and again while the map leads there."""
    place = mapped_corridor(
        replace(method, recovering=replace(method.recovering, give_up_after_looks=3, step_limit=400))
    )
    block_corridor(place)
    for query in range(queries):
        place.robot.pose = np.array([0.6, 1.0, 0.0])
        assert not place.go(5, query)[0].reached
        if (2, 3) not in place.graph.edges:
            break
    assert place.robot.collisions > 0
    return place


def test_an_edge_that_is_blocked_leaves_the_map_after_repeats() -> None:
    # What hinders the robot says little of the edge, so it takes many queries.
    assert (2, 3) not in drive_at_the_wall(ROBUST, queries=30).graph.edges


def test_the_literal_method_takes_a_blocked_edge_for_a_success_while_its_end_is_in_sight() -> None:
    place = drive_at_the_wall(PAPER, queries=2)
    assert place.graph.edges[2, 3].successes == place.graph.edges[2, 3].attempts > 1


def test_the_robust_method_prunes_no_edge_in_its_first_query() -> None:
    place = mapped_corridor(replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=400)))
    block_corridor(place)
    _, events = place.go(5)
    assert not [event for event in events_of(GraphChanged, events) if isinstance(event.delta, EdgePruned)]
    assert place.graph.edges[2, 3].attempts == 1


def test_a_false_long_range_edge_is_avoided_for_the_rest_of_the_query_and_then_pruned() -> None:
    place = mapped_corridor(ROBUST)
    join_nodes(place, 0, 6, 1.2)
    place.predictor.lies[(FIRST_STEP, 6)] = np.array([1.2, 0.0, 0.0])
    for query in range(3):
        place.robot.pose = np.array([0.6, 1.0, 0.0])
        place.robot.step = FIRST_STEP
        episode, events = place.go(6, query)
        assert episode.reached
        if query == 0:
            assert (events_of(AttemptStarted, events)[0].source, events_of(AttemptStarted, events)[0].target) == (0, 6)
    assert (0, 6) not in place.graph.edges


def test_a_map_cut_in_two_is_joined_through_the_reserve() -> None:
    place = mapped_rooms(ROBUST)
    left = {node for node in place.graph.nodes if place.poses[node][0] < 3.0}
    for source, target in list(place.graph.edges):
        if (source in left) != (target in left):
            place.graph.apply(EdgePruned(source, target, Cause.HAND))
    goal = place.nearest(5.2, 3.2)
    episode, events = place.go(goal)
    assert episode.reached
    causes = {event.delta.cause for event in events_of(GraphChanged, events)}
    assert Cause.EXPAND in causes


def test_queries_in_turn_count_what_became_of_the_map() -> None:
    place = mapped_rooms(ROBUST)
    goals = random_goals(list(place.graph.nodes), 5, np.random.default_rng(3))
    events: list[Event] = []
    results = list(
        run_queries(
            place.navigator(),
            goals,
            first_query=10,
            advance=place.robot.advance,
            verdict=lambda query, goal: judge_goal_reached(query, place.robot.pose, place.poses[goal]),
            consume=events.append,
        )
    )
    assert [(result.query, result.goal) for result in results] == list(enumerate(goals, 10))
    assert all(result.reached and not result.collisions for result in results)
    changes = [event.delta for event in events_of(GraphChanged, events)]
    assert sum(result.added_edges for result in results) == sum(isinstance(each, EdgeAdded) for each in changes)
    assert sum(result.pruned for result in results) == sum(isinstance(each, EdgePruned) for each in changes)


def test_goals_never_repeat_at_once_and_need_a_map() -> None:
    goals = random_goals([1, 2, 3], 50, np.random.default_rng(0))
    assert all(a != b for a, b in itertools.pairwise(goals))
    assert random_goals([4], 2, np.random.default_rng(0)) == (4, 4)
    with pytest.raises(MapError, match="no nodes to go to"):
        random_goals([], 1, np.random.default_rng(0))
