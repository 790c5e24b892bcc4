"""The story of a door that closes and opens again, on the demo map; the events are as a query has them."""

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.data.recording.map_file import LoadedMap, load_map
from ltvn_core.evaluation.door_story.story import (
    NO_STORY,
    STEPS_AT_DOOR,
    STEPS_BEYOND_DOOR,
    CallBack,
    Carry,
    Change,
    DoorStory,
    GoTo,
    Lead,
    StoryStep,
)
from ltvn_core.evaluation.door_story.story_map import Stage, StoryMap
from ltvn_core.evaluation.door_story.unknown_way import UnknownWay
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Belief, Cause, EdgeAdded, NodeAdded, PresenceObserved
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import Edge, EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene import door_names
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.worlds import DoorMoved, ThingRemoved, TimePassed
from tests.repository import DEMO_MAP

pytest.importorskip("embreex")

TABLE = "own/high-table-1"
"""It stands in the kitchen of the demo apartment and bars the way from door to door."""


@pytest.fixture(scope="module")
def known() -> LoadedMap:
    return load_map(DEMO_MAP)


@pytest.fixture
def story_map(known: LoadedMap) -> StoryMap:
    pose = known.observations[min(known.graph.nodes)].exact_pose
    assert pose is not None
    system = with_maintenance(ltvn_system(ROBUST), "persistent")
    world = World(load_scene("demo"))
    return StoryMap(known.graph.copy(), system, world, known.observations.__getitem__, lambda: pose)


@pytest.fixture(scope="module")
def unknown(known: LoadedMap) -> UnknownWay:
    world = World(load_scene("demo"))
    system = with_maintenance(ltvn_system(ROBUST), "persistent")
    way = StoryMap(known.graph, system, world, known.observations.__getitem__, lambda: np.zeros(3)).unknown_way()
    assert way is not None
    return way


def lead(story_map: StoryMap, way: UnknownWay) -> list[Event]:
    """Let the map know the way as if the robot had been led along it: by one long edge there and one back."""
    nodes = list(story_map.graph.nodes)
    places = np.array([story_map.pose(node)[:2] for node in nodes])
    first, last = (nodes[int(np.hypot(*(places - end).T).argmin())] for end in (way.path[0], way.path[-1]))
    events: list[Event] = []
    for source, target in ((first, last), (last, first)):
        waypoint = pose_row(relative(story_map.pose(source), story_map.pose(target)))
        delta = EdgeAdded(Edge(source, target, waypoint, Belief(0.95, way.length_m, 0.01)), Cause.ONLINE)
        story_map.graph.apply(delta)
        events.append(GraphChanged(delta))
    return events


def way(story_map: StoryMap, stage: Stage) -> tuple[int, ...]:
    planner = Planner(story_map.graph, story_map.system.method.planning)
    return planner.plan(stage.start, stage.goal).nodes


def seen(edge: EdgeKey, *, present: bool, stamp: float) -> Event:
    return GraphChanged(PresenceObserved(*edge, present=present, stamp=stamp, cause=Cause.ATTEMPT), query=0, attempt=1)


def ended(stage: Stage, outcome: Outcome) -> Event:
    return QueryEnded(0, stage.goal, outcome, steps=1, collisions=0, path_m=0.0)


def until(story: DoorStory, kind: type[StoryStep]) -> StoryStep:
    """Let an idle robot do what the story says up to a step of a kind, and return that."""
    for _ in range(10):
        step = story.next_step(is_idle=True)
        if isinstance(step, kind):
            return step
    raise AssertionError(f"no {kind.__name__} came, {story.captions}")


def sent(story_map: StoryMap, unknown: UnknownWay) -> tuple[DoorStory, Stage]:
    """A story whose robot was led through the kitchen and is on its way by itself."""
    story = DoorStory(story_map, door_names(story_map.world.base))
    until(story, Lead)
    for event in lead(story_map, unknown):
        story.take(event)
    until(story, GoTo)
    assert story.stage is not None
    return story, story.stage


def test_the_kitchen_table_bars_a_way_that_the_map_lacks(story_map: StoryMap, unknown: UnknownWay) -> None:
    assert unknown.moved_away == TABLE
    assert story_map.room(unknown.path[len(unknown.path) // 2]) == "kitchen"
    story_map.world.apply(ThingRemoved(TABLE))
    assert story_map.world.scene.clearance.at(unknown.path).min() > 0.18, "the robot fits through"
    places = np.array([story_map.pose(node)[:2] for node in story_map.graph.nodes])
    away = np.hypot(*(unknown.path[:, None] - places[None]).transpose(2, 0, 1)).min(1)
    assert max(away[0], away[-1]) < 0.7 < away.max()


def test_the_robot_is_led_first_and_then_has_two_ways(story_map: StoryMap, unknown: UnknownWay) -> None:
    story = DoorStory(story_map, door_names(story_map.world.base))
    assert story.next_step(is_idle=True) == Change(ThingRemoved(TABLE))
    assert isinstance(story.next_step(is_idle=True), Carry)
    led = story.next_step(is_idle=True)
    assert isinstance(led, Lead)
    assert np.array_equal(led.path, unknown.path)
    lead(story_map, unknown)
    carried, going = until(story, Carry), until(story, GoTo)
    stage = story.stage
    assert stage is not None
    assert stage.has_way_round
    assert going == GoTo(stage.goal)
    assert isinstance(carried, Carry)
    assert np.array_equal(carried.pose, story_map.pose(stage.start))
    assert story_map.passes(way(story_map, stage), stage.door)
    assert not story_map.passes([stage.start], stage.door)


def test_an_edge_fades_a_plan_turns_a_node_appears_and_an_edge_returns(
    story_map: StoryMap, unknown: UnknownWay, known: LoadedMap
) -> None:
    story, stage = sent(story_map, unknown)
    assert story.next_step(is_idle=False) is None, "nothing closes before there is a plan"
    story.take(Planned(0, way(story_map, stage), 1.0))
    assert story.next_step(is_idle=False) == Change(DoorMoved(stage.door, is_open=False))
    edge = next(iter(story_map.graph.edges))
    story.take(seen(edge, present=False, stamp=1.0))
    assert "absent now, not forgotten" in story.captions[-1]
    story.take(Planned(0, (stage.start,), 1.0))
    assert "The plan changes" in story.captions[-1]
    for observation in list(known.observations.values())[:3]:
        story.take(GraphChanged(NodeAdded(node_from_observation(observation), Cause.NOVEL)))
    assert "New nodes appear" in story.captions[-1]
    story.take(ended(stage, Outcome.ARRIVED))
    assert story.next_step(is_idle=True) == Change(DoorMoved(stage.door, is_open=True))
    passed = until(story, Change)
    assert isinstance(passed, Change)
    assert isinstance(passed.change, TimePassed)
    assert isinstance(story.next_step(is_idle=True), Carry)
    assert story.next_step(is_idle=True) == GoTo(stage.goal)
    story.take(seen(edge, present=True, stamp=2.0))
    assert story.next_step(is_idle=False) is None, "it drives on to its goal"
    story.take(ended(stage, Outcome.ARRIVED))
    assert story.is_over
    facts = story.facts
    assert (facts.absent, facts.returned, facts.rerouted, facts.nodes_added) == ([edge], {edge}, True, 3)
    assert "1 edges were absent for a while, 1 of them are back; 3 nodes" in story.captions[-2]
    assert story.captions[-1] == "The story is over: the robot arrived."


def test_a_robot_that_finds_some_edges_open_is_not_kept_for_the_others(
    story_map: StoryMap, unknown: UnknownWay
) -> None:
    story, stage = sent(story_map, unknown)
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    first, other, *_ = story_map.graph.edges
    for edge in (first, other):
        story.take(seen(edge, present=False, stamp=1.0))
    story.take(ended(stage, Outcome.ARRIVED))
    until(story, GoTo)
    story.take(seen(first, present=True, stamp=2.0))
    steps = [story.next_step(is_idle=False) for _ in range(STEPS_BEYOND_DOOR)]
    assert [step for step in steps if step is not None] == [CallBack()]


def test_a_robot_that_went_round_without_seeing_why_is_sent_out_again(story_map: StoryMap, unknown: UnknownWay) -> None:
    story, stage = sent(story_map, unknown)
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    story.take(ended(stage, Outcome.ARRIVED))
    carried = story.next_step(is_idle=True)
    assert isinstance(carried, Carry)
    assert np.array_equal(carried.pose, story_map.pose(stage.start))
    assert story.next_step(is_idle=True) == GoTo(stage.goal)
    assert "starts again" in story.captions[-1]


def test_where_no_way_leads_round_the_robot_is_called_back(story_map: StoryMap, unknown: UnknownWay) -> None:
    story = DoorStory(story_map, door_names(story_map.world.base))
    until(story, Lead)  # It was led, and the map learned nothing from it.
    until(story, GoTo)
    stage = story.stage
    assert stage is not None
    assert not stage.has_way_round
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    story.take(seen(next(iter(story_map.graph.edges)), present=False, stamp=1.0))
    steps = [story.next_step(is_idle=False) for _ in range(STEPS_AT_DOOR)]
    assert [step for step in steps if step is not None] == [CallBack()]
    story.take(ended(stage, Outcome.CANCELLED))
    assert story.next_step(is_idle=True) == Change(DoorMoved(stage.door, is_open=True))


def test_a_story_that_is_stopped_leaves_the_door_open(story_map: StoryMap, unknown: UnknownWay) -> None:
    story, stage = sent(story_map, unknown)
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    assert story.stop("Enough.") == Change(DoorMoved(stage.door, is_open=True))
    assert story.is_over
    assert story.next_step(is_idle=True) is None


def test_without_a_map_there_is_no_story(story_map: StoryMap) -> None:
    story_map.graph = TopologicalGraph()
    story = DoorStory(story_map, ())
    assert story.next_step(is_idle=True) is None
    assert story.captions == [NO_STORY]
