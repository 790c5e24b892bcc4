"""A map with several floors: the page shows one of them, the robot's or the one that a person chose."""

from pathlib import Path

import pytest

from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.viz.session_harness import SessionHarness
from tests.viz.two_floors import add_lift, is_in_first_room, lift_ends, nearest, open_two_rooms


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """Two rooms that are two floors, joined by a lift."""
    harness = open_two_rooms(tmp_path)
    harness.do(add_lift(harness), ticks=2)
    return harness


def rooms(harness: SessionHarness, shown: Snapshot) -> set[bool]:
    return {is_in_first_room(harness, node) for node in shown.moment.graph.ids.tolist()}


def test_one_floor_is_shown_with_its_own_edges_and_its_exit(harness: SessionHarness) -> None:
    shown = harness.now
    graph = shown.moment.graph
    assert shown.floor is not None
    assert (shown.floor.floor, shown.floor.floors) == (0, 2)
    assert len(rooms(harness, shown)) == 1
    assert graph.edges.max() < len(graph.ids)
    assert not graph.acts.any()
    driven = harness.state.live_map.graph.driven_edges
    on_it = {key for key in driven if {*key} <= set(graph.ids.tolist())}
    assert {(int(graph.ids[a]), int(graph.ids[b])) for a, b in graph.edges} == on_it


def test_a_person_chooses_a_floor_and_goes_back_to_the_robots(harness: SessionHarness) -> None:
    harness.do(c.NavigateTo(nearest(harness, 1.0, 2.0)))
    harness.until(lambda now: now.moment.progress.localised is not None)
    robots = harness.wait(2).moment.graph
    assert rooms(harness, harness.now) == {True}
    assert robots.exits.sum() == 1
    assert int(robots.ids[robots.exits][0]) == lift_ends(harness)[0]
    assert harness.now.floor is not None
    other = harness.do(c.ShowFloor(1 - harness.now.floor.floor))
    assert rooms(harness, other) == {False}
    assert harness.wait().moment.graph is other.moment.graph
    assert other.moment.robot is None
    back = harness.do(c.ShowFloor())
    assert rooms(harness, back) == {True}
    assert back.moment.robot is not None


def test_a_map_of_one_floor_is_shown_whole(tmp_path: Path) -> None:
    harness = open_two_rooms(tmp_path)
    shown = harness.wait()
    assert shown.floor is None
    assert rooms(harness, shown) == {True, False}
