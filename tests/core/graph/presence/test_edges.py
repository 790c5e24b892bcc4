"""What closes edges and opens them, and which way is taken then."""

import math

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import Cause, EdgePruned, PresenceObserved
from ltvn_core.graph.ltvn import PresenceMaintenance
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.presence.edge_presence import FilteredPresence, plan_by_presence
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed
from ltvn_core.graph.presence.presence_filter import PERSISTENT
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from tests.core.graph.small_maps import edge_added, node_added

NOTHING = np.empty((0, 2))
MAINTENANCE = PresenceMaintenance(ROBUST)


def row(count: int = 6, *, drift_m: float = 0.0) -> TopologicalGraph:
    """Return nodes in a row, 0.6 m apart, joined both ways; odometry of the n-th is wrong by n times the drift."""
    nodes = [node_added(k, 0.6 * k + drift_m * k) for k in range(count)]
    edges = [each for k in range(1, count) for each in (edge_added(k - 1, k, 0.6), edge_added(k, k - 1, -0.6))]
    return TopologicalGraph([*nodes, *edges])


def door(x: float, low: float, high: float) -> np.ndarray:
    """Return points across the row, from y = low to high."""
    aside = np.arange(low, high, 0.05)
    return np.stack([np.full_like(aside, x), aside], axis=-1)


def seen(points: np.ndarray, *, node: int = 0, known: np.ndarray = NOTHING, stopped: bool = False) -> Obstruction:
    return Obstruction(node=node, points=points, known=known, stopped=stopped)


def fail(obstruction: Obstruction | None, *, stamp: float = 0.0) -> AttemptEvidence:
    return AttemptEvidence(source=2, target=3, distance=0.6, succeeded=False, stamp=stamp, obstruction=obstruction)


@pytest.mark.parametrize("drift_m", [0.0, 0.4])
def test_a_door_closes_the_edges_that_pass_it_and_no_others(drift_m: float) -> None:
    graph = row(drift_m=drift_m)
    assert set(edges_obstructed(graph, seen(door(1.5, -0.5, 0.5)))) == {(2, 3), (3, 2)}


def test_a_way_that_ends_just_before_a_door_is_closed_and_one_that_begins_there_is_not() -> None:
    assert set(edges_obstructed(row(), seen(door(1.3, -0.5, 0.5)))) == {(1, 2), (2, 3), (3, 2)}


def test_a_door_is_closed_for_a_way_near_its_jamb_although_the_jamb_was_always_there() -> None:
    leaf, jamb = door(1.5, -0.5, 0.1), door(1.5, 0.1, 0.4)
    assert not edges_obstructed(row(), seen(leaf))
    assert set(edges_obstructed(row(), seen(leaf, known=jamb))) == {(2, 3), (3, 2)}


def test_what_stands_beside_a_way_or_leaves_room_closes_nothing() -> None:
    for points in (door(1.5, 0.1, 0.5), door(1.5, -0.1, 0.1), door(1.5, 0.25, 1.0)):
        assert not edges_obstructed(row(), seen(points))


def test_a_box_that_stopped_the_robot_closes_the_edge_that_it_drove_alone() -> None:
    graph = row()
    deltas = MAINTENANCE.after_attempt(graph, fail(seen(door(0.3, -0.1, 0.1), node=2, stopped=True)))
    assert deltas == (PresenceObserved(2, 3, present=False, stamp=0.0, cause=Cause.ATTEMPT),)


def test_what_closes_an_edge_says_nothing_of_its_existence() -> None:
    graph = row()
    for stamp in range(0, 10_000, 100):
        for delta in MAINTENANCE.after_attempt(graph, fail(seen(door(0.3, -0.4, 0.4), node=2), stamp=float(stamp))):
            graph.apply(delta)
    assert graph.edges == row().edges
    assert set(graph.presence) == {(2, 3), (3, 2)}


def test_many_tries_in_one_jam_are_one_observation() -> None:
    graph = row()
    for stamp in range(100):
        for delta in MAINTENANCE.after_attempt(graph, fail(seen(door(0.3, -0.4, 0.4), node=2), stamp=stamp / 10)):
            graph.apply(delta)
    assert [len(history) for history in graph.presence.values()] == [1, 1]


def test_a_failure_without_anything_new_in_view_is_no_evidence_of_presence() -> None:
    deltas = MAINTENANCE.after_attempt(row(), fail(None))
    assert not [delta for delta in deltas if isinstance(delta, PresenceObserved)]


def test_who_gets_through_opens_all_edges_that_were_closed_together() -> None:
    graph = row()
    graph.apply(PresenceObserved(4, 5, present=False, stamp=3.0, cause=Cause.SIGHT))
    for delta in MAINTENANCE.after_attempt(graph, fail(seen(door(0.3, -0.4, 0.4), node=2), stamp=7.0)):
        graph.apply(delta)
    success = AttemptEvidence(source=3, target=2, distance=0.6, succeeded=True, stamp=900.0)
    opened = [each for each in MAINTENANCE.after_attempt(graph, success) if isinstance(each, PresenceObserved)]
    assert {(each.source, each.target): each.present for each in opened} == {(3, 2): True, (2, 3): True}


def test_who_arrives_before_a_door_does_not_open_what_was_closed_again_since() -> None:
    graph = row()
    for stamp, leaf in ((7.0, door(1.3, -0.5, 0.5)), (500.0, door(1.5, -0.5, 0.5))):
        for delta in MAINTENANCE.after_attempt(graph, fail(seen(leaf), stamp=stamp)):
            graph.apply(delta)
    success = AttemptEvidence(source=1, target=2, distance=0.6, succeeded=True, stamp=900.0)
    opened = [each for each in MAINTENANCE.after_attempt(graph, success) if isinstance(each, PresenceObserved)]
    assert [(each.source, each.target) for each in opened] == [(1, 2)]


def test_of_two_doors_that_are_seen_at_once_one_opens_without_the_other() -> None:
    graph = row()
    both = seen(np.concatenate([door(0.9, -0.5, 0.5), door(2.1, -0.5, 0.5)]))
    for delta in MAINTENANCE.after_attempt(graph, fail(both, stamp=7.0)):
        graph.apply(delta)
    assert set(graph.presence) == {(1, 2), (2, 1), (3, 4), (4, 3)}
    opened = FilteredPresence(PERSISTENT).observe_open(graph, [(3, 4)], 900.0)
    assert {(each.source, each.target) for each in opened} == {(3, 4), (4, 3)}


def test_what_a_second_look_finds_closed_belongs_to_what_the_first_did() -> None:
    graph = row()
    for stamp, leaf in ((7.0, door(1.5, -0.5, 0.5)), (9.0, door(1.3, -0.5, 0.5))):
        for delta in MAINTENANCE.after_attempt(graph, fail(seen(leaf), stamp=stamp)):
            graph.apply(delta)
    assert len(FilteredPresence(PERSISTENT).observe_open(graph, [(3, 2)], 900.0)) == 3


def failures(graph: TopologicalGraph, key: EdgeKey, count: int = 12) -> bool:
    """Let an edge fail again and again; tell whether it left the map."""
    for stamp in range(count):
        if key in graph.edges:
            attempt = AttemptEvidence(source=key[0], target=key[1], distance=0.6, succeeded=False, stamp=1000.0 * stamp)
            for delta in MAINTENANCE.after_attempt(graph, attempt):
                graph.apply(delta)
    return key not in graph.edges


def test_only_what_was_never_driven_leaves_for_ever() -> None:
    graph = row()
    graph.apply(edge_added(0, 5, 0.5))
    graph.apply(edge_added(0, 4, 0.5, attempts=1, successes=1))
    assert failures(graph, (0, 5))
    assert not failures(graph, (0, 4)), "It was driven once."
    assert not failures(graph, (2, 3)), "It joins two images that followed each other."


def two_ways() -> tuple[TopologicalGraph, Planner]:
    """Return a short way 0-1-2 and a long one 0-3-4-2, which can be joined from 1 as well."""
    graph = TopologicalGraph(map(node_added, range(5)))
    for source, target, length in ((0, 1, 1), (1, 2, 1), (0, 3, 3), (3, 4, 3), (4, 2, 3), (1, 0, 1)):
        graph.apply(edge_added(source, target, length))
    return graph, Planner(graph, ROBUST.planning)


@pytest.mark.parametrize(
    ("p", "tries", "nodes"),
    [
        (0.9, 0, (0, 1, 2)),
        (0.4, 0, (0, 1, 2)),
        (0.1, 0, (0, 3, 4, 2)),
        (0.4, 1, (0, 3, 4, 2)),
    ],
)
def test_a_closed_way_is_looked_at_again_where_that_is_worth_it_and_once(
    p: float, tries: int, nodes: tuple[int, ...]
) -> None:
    _, planner = two_ways()
    assert plan_by_presence(planner, 0, 2, {}, {(1, 2): p}, belief_weight=1.5, tries=tries).nodes == nodes


def test_where_no_other_way_is_a_closed_one_is_tried_once_and_again_when_there_is_hope() -> None:
    graph, planner = two_ways()
    graph.apply(EdgePruned(4, 2, Cause.HAND))
    for p, tries, found in ((0.01, 0, True), (0.01, 1, False), (0.3, 1, True)):
        plan = plan_by_presence(planner, 0, 2, {}, {(1, 2): p}, belief_weight=1.5, tries=tries)
        assert bool(plan.nodes) == found


def test_penalties_of_the_query_still_count() -> None:
    _, planner = two_ways()
    assert plan_by_presence(planner, 0, 2, {(0, 1): math.inf}, {(1, 2): 0.9}, belief_weight=1.5).nodes == (0, 3, 4, 2)


def test_only_edges_that_were_seen_blocked_are_doubtful_and_time_heals() -> None:
    graph, presence = row(), FilteredPresence(PERSISTENT)
    assert not presence.probabilities(graph, 0.0)
    graph.apply(PresenceObserved(2, 3, present=False, stamp=50.0, cause=Cause.ATTEMPT))
    soon, later = (presence.probabilities(graph, at)[2, 3] for at in (51.0, 5000.0))
    assert soon < 0.1
    assert later > 0.5
    assert presence.probabilities(graph, 3.0)[2, 3] == pytest.approx(presence.probabilities(graph, 50.0)[2, 3])
