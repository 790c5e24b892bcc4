"""The story of a door that closes and opens again, on the shipped map; the events are as a query has them."""

import itertools
from dataclasses import dataclass, field

import pytest

from ltvn_core.config import ROBUST
from ltvn_core.data.recording.map_file import LoadedMap, load_map
from ltvn_core.evaluation.door_story.story import READ_S, SETTLED_STEPS, Change, DoorStory, Edit, GoTo, Lead, StoryStep
from ltvn_core.evaluation.door_story.story_map import (
    GOAL,
    LED_ALONG,
    START,
    TABLE,
    WRONG_EDGE,
    StoryMap,
    why_no_story,
)
from ltvn_core.graph.deltas import Cause, EdgePruned, PresenceObserved
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene import door_names
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.worlds import DoorMoved, ThingRemoved
from tests.repository import DEMO_MAP

pytest.importorskip("embreex")


@pytest.fixture(scope="module")
def known() -> LoadedMap:
    return load_map(DEMO_MAP)


@pytest.fixture
def story_map(known: LoadedMap) -> StoryMap:
    system = with_maintenance(ltvn_system(ROBUST), "persistent")
    return StoryMap(known.graph.copy(), system, World(load_scene("demo")), known.observations.__getitem__)


@dataclass
class Player:
    """Plays a story as far as asked, in a time of its own, and notes when each caption is told."""

    story: DoorStory
    map: StoryMap
    now_s: float = 0.0
    told_s: list[float] = field(default_factory=list)

    def step(self, *, is_idle: bool) -> StoryStep | None:
        self.now_s += 0.1
        step = self.story.next_step(is_idle=is_idle)
        self.told_s += [self.now_s] * (len(self.story.captions) - len(self.told_s))
        match step:
            case Change(change):
                self.map.world.apply(change)
            case Edit(delta):
                self.map.graph.apply(delta)
            case _:
                pass
        return step

    def until(self, kind: type[StoryStep], *, is_idle: bool = True) -> StoryStep:
        for _ in range(500):
            step = self.step(is_idle=is_idle)
            if isinstance(step, kind):
                return step
        raise AssertionError(f"no {kind.__name__} came, {self.story.captions}")

    def drive(self, steps: int = 100) -> None:
        for _ in range(steps):
            self.step(is_idle=False)

    def told(self, words: str) -> bool:
        return any(words in caption for caption in self.story.captions)

    def take(self, *events: Event) -> None:
        for event in events:
            self.story.take(event)


@pytest.fixture
def player(story_map: StoryMap) -> Player:
    player = Player(None, story_map)  # type: ignore[arg-type]
    player.story = DoorStory(story_map, door_names(story_map.world.base), lambda: player.now_s)
    return player


def way(story_map: StoryMap) -> tuple[int, ...]:
    return Planner(story_map.graph, story_map.system.method.planning).plan(START, GOAL).nodes


def seen(edge: EdgeKey, *, present: bool, stamp: float = 1.0) -> Event:
    return GraphChanged(PresenceObserved(*edge, present=present, stamp=stamp, cause=Cause.ATTEMPT), query=0, attempt=1)


def ended(outcome: Outcome) -> Event:
    return QueryEnded(0, GOAL, outcome, steps=1, collisions=0, path_m=0.0)


def at_closed_door(player: Player) -> list[EdgeKey]:
    """Play up to the closed door; return the edges through it."""
    player.until(GoTo)
    through = player.map.through_door(list(player.map.graph.edges))
    pruned = EdgePruned(*WRONG_EDGE, Cause.ATTEMPT)
    player.map.graph.apply(pruned)
    player.take(GraphChanged(pruned), Planned(0, way(player.map), 1.0))
    assert player.until(Change, is_idle=False) == Change(DoorMoved(0, is_open=False))
    return through


def at_open_door(player: Player, blocked: list[EdgeKey]) -> None:
    """Let the robot see edges blocked and arrive by the other path, and play up to its second start."""
    player.take(*(seen(edge, present=False) for edge in blocked), Planned(0, (START,), 1.0))
    player.drive()
    player.take(ended(Outcome.ARRIVED))
    assert player.until(Change) == Change(DoorMoved(0, is_open=True))
    player.until(GoTo)


def test_the_table_bars_a_way_that_the_map_lacks_and_the_robot_is_led_along_it(player: Player) -> None:
    assert not player.map.knows_other_way
    assert player.until(Change) == Change(ThingRemoved(TABLE))
    assert player.map.world.scene.clearance.at(LED_ALONG).min() > 0.18, "the robot fits through"
    assert isinstance(player.until(Lead), Lead)


def test_the_plan_leads_through_the_door_and_the_wrong_edge_comes_first(player: Player) -> None:
    assert player.map.passes(way(player.map))
    assert player.until(GoTo) == GoTo(GOAL)
    assert way(player.map) == WRONG_EDGE
    assert not player.map.passes(way(player.map)), "it only seems to lead anywhere"


def test_each_caption_stands_until_it_was_read(player: Player) -> None:
    blocked = at_closed_door(player)
    at_open_door(player, blocked)
    player.take(*(seen(edge, present=True, stamp=2.0) for edge in blocked), ended(Outcome.ARRIVED))
    while not player.story.is_over:
        player.step(is_idle=True)
    gaps = [later - before for before, later in itertools.pairwise(player.told_s)]
    assert gaps
    assert min(gaps) >= READ_S - 1e-6


def test_the_prune_and_the_fading_are_told_when_they_happen_and_not_before(player: Player) -> None:
    player.until(GoTo)
    player.drive()
    assert not player.told("prunes")
    player.story.captions.clear()
    pruned = EdgePruned(*WRONG_EDGE, Cause.ATTEMPT)
    player.map.graph.apply(pruned)
    player.take(GraphChanged(pruned), Planned(0, way(player.map), 1.0))
    player.until(Change, is_idle=False)
    assert player.told("prunes")
    assert not player.told("fade")
    player.take(seen(player.map.through_door(list(player.map.graph.edges))[0], present=False))
    player.drive()
    assert player.told("fade")


def test_edges_return_only_after_the_door_was_opened_and_those_that_remain_are_counted(player: Player) -> None:
    blocked = at_closed_door(player)
    player.take(*(seen(edge, present=False) for edge in blocked), seen(blocked[0], present=True))
    player.drive()
    assert not player.told("return"), "the door is closed: what seems open is none of its edges"
    at_open_door(player, blocked)
    player.drive()
    assert not player.told("return"), "nothing was seen open yet"
    player.take(*(seen(edge, present=True, stamp=2.0) for edge in blocked[:-1]))
    player.drive(SETTLED_STEPS + 60)
    assert player.told(f"{len(blocked) - 1} edges return. 1 ")
    player.take(ended(Outcome.ARRIVED))
    while not player.story.is_over:
        player.step(is_idle=True)
    assert "arrived" in player.story.captions[-1]


def test_a_robot_that_went_round_without_seeing_why_ends_the_story_with_the_door_open(player: Player) -> None:
    at_closed_door(player)
    player.take(ended(Outcome.ARRIVED))
    assert player.until(Change) == Change(DoorMoved(0, is_open=True))
    assert player.told("ends here")
    assert player.step(is_idle=True) is None
    assert player.story.is_over
    assert not player.story.stop("Enough.")


def test_a_story_that_is_stopped_leaves_the_door_open_and_no_wrong_edge(player: Player) -> None:
    player.until(GoTo)
    assert not player.story.leftovers()
    player.take(Planned(0, tuple(node for node in way_without_wrong_edge(player.map)), 1.0))
    player.until(Change, is_idle=False)
    assert player.story.stop("Enough.") == (Change(DoorMoved(0, is_open=True)),)
    (left,) = player.story.leftovers()
    player.map.graph.apply(left)
    assert not player.story.leftovers()
    assert player.step(is_idle=True) is None


def way_without_wrong_edge(story_map: StoryMap) -> tuple[int, ...]:
    return Planner(story_map.graph, story_map.system.method.planning).plan(START, GOAL, {WRONG_EDGE: 1e3}).nodes


def test_the_story_plays_in_the_shipped_map_only(known: LoadedMap) -> None:
    demo = load_scene("demo")
    assert why_no_story(demo, known.graph, known.observations.__getitem__) == ""
    assert "ltvn app" in why_no_story(demo, TopologicalGraph(), known.observations.__getitem__)
    moved = {START: known.observations[GOAL], GOAL: known.observations[START]}
    assert why_no_story(demo, known.graph, lambda node: moved.get(node, known.observations[node]))
    assert why_no_story(load_scene("train-00"), known.graph, known.observations.__getitem__)
