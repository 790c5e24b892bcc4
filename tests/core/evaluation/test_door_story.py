"""The story of a door that closes and opens again, on the demo map; the events are as a query has them."""

import math

import pytest

from ltvn_core.config import ROBUST
from ltvn_core.evaluation.door_story.story import NO_STORY, CallBack, Change, DoorStory, GoTo
from ltvn_core.evaluation.door_story.story_map import Stage, StoryMap
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.recording.map_file import LoadedMap, load_map
from ltvn_core.simulation.changes.door_names import door_names
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.worlds.world_change import DoorMoved, TimePassed
from tests.repository import DEMO_MAP

pytest.importorskip("pybullet")


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


def way(story_map: StoryMap, stage: Stage) -> tuple[int, ...]:
    planner = Planner(story_map.graph, story_map.system.method.planning)
    return planner.plan(stage.start, stage.goal).nodes


def seen(edge: EdgeKey, *, present: bool, stamp: float) -> Event:
    return GraphChanged(PresenceObserved(*edge, present=present, stamp=stamp, cause=Cause.ATTEMPT), query=0, attempt=1)


def test_the_story_plays_where_a_way_of_the_map_leads_through_a_door(story_map: StoryMap) -> None:
    stage = story_map.stage()
    assert stage is not None
    assert story_map.passes(way(story_map, stage), stage.door)
    assert not story_map.passes([stage.start], stage.door)
    assert 0 < stage.length_m < math.inf


def test_a_door_closes_on_the_plan_and_opens_again_and_the_edges_return(story_map: StoryMap) -> None:
    story = DoorStory(story_map, door_names(story_map.world.base))
    step = story.next_step(is_idle=True)
    stage = story.stage
    assert stage is not None
    assert step == GoTo(stage.goal)
    assert story.next_step(is_idle=False) is None, "nothing closes before there is a plan"
    story.take(Planned(0, way(story_map, stage), 1.0))
    assert story.next_step(is_idle=False) == Change(DoorMoved(stage.door, is_open=False))
    edge = next(iter(story_map.graph.edges))
    story.take(seen(edge, present=False, stamp=1.0))
    assert "absent now, and not forgotten" in story.captions[-1]
    called = next(step for _ in range(1000) if (step := story.next_step(is_idle=False)) is not None)
    assert called == CallBack(), "the demo map knows no way round"
    story.take(QueryEnded(0, stage.goal, Outcome.CANCELLED, steps=1, collisions=0, path_m=0.0))
    assert story.next_step(is_idle=True) == Change(DoorMoved(stage.door, is_open=True))
    passed = story.next_step(is_idle=True)
    assert isinstance(passed, Change)
    assert isinstance(passed.change, TimePassed)
    assert story.next_step(is_idle=True) == GoTo(edge[0]), "it is sent along the edge itself"
    story.take(seen(edge, present=True, stamp=2.0))
    story.take(QueryEnded(1, edge[0], Outcome.ARRIVED, steps=1, collisions=0, path_m=0.0))
    assert story.is_over
    assert story.facts.absent == [edge]
    assert story.facts.returned == {edge}
    assert not story.facts.rerouted
    assert "1 of them are back" in story.captions[-1]


def test_a_plan_that_turns_away_from_the_closed_door_is_told(story_map: StoryMap) -> None:
    story = DoorStory(story_map, door_names(story_map.world.base))
    story.next_step(is_idle=True)
    stage = story.stage
    assert stage is not None
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    story.take(Planned(0, (stage.start,), 1.0))
    assert story.facts.rerouted
    assert "The plan turns" in story.captions[-1]


def test_a_story_that_is_stopped_leaves_the_door_open(story_map: StoryMap) -> None:
    story = DoorStory(story_map, door_names(story_map.world.base))
    story.next_step(is_idle=True)
    stage = story.stage
    assert stage is not None
    story.take(Planned(0, way(story_map, stage), 1.0))
    story.next_step(is_idle=False)
    assert story.stop("Enough.") == Change(DoorMoved(stage.door, is_open=True))
    assert story.is_over


def test_without_a_map_there_is_no_story(story_map: StoryMap) -> None:
    story_map.graph = TopologicalGraph()
    story = DoorStory(story_map, ())
    assert story.next_step(is_idle=True) is None
    assert story.captions == [NO_STORY]
