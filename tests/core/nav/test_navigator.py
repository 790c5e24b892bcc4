"""The whole loop in a flat world: it arrives, learns, recovers, gives up in time, and always stops the robot."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.graph.beliefs import initial
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, EdgePruned, NodeAdded, NodeDropped, PoseRow
from ltvn_core.graph.operators import node_of
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.nav.episode import Episode, judge, run_episode
from ltvn_core.nav.events import (
    Collided,
    Event,
    GraphChanged,
    LegEnd,
    LegEnded,
    LegStarted,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
    QueryStarted,
    StateChanged,
    Tick,
)
from ltvn_core.nav.lifelong import Lifelong, random_goals
from ltvn_core.nav.navigator import Navigator
from ltvn_core.types import NodeId, Observation, Pose
from tests.core.world import FlatPredictor, FlatRobot, FlatWorld, look_at, one_room, tour, two_rooms

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
WAY = [(0.8, 0.8), (2.3, 0.8), (2.3, 2.0), (3.8, 2.0), (5.2, 0.8), (5.2, 3.2), (3.8, 2.0), (2.2, 2.0), (0.8, 3.2)]
FIRST_STEP = 100_000


@dataclass
class Place:
    """A world with a map of it and a robot in it."""

    world: FlatWorld
    robot: FlatRobot
    graph: TopologicalGraph
    views: Views
    predictor: FlatPredictor
    method: Method
    poses: dict[NodeId, Pose]

    def navigator(self) -> Navigator:
        return Navigator(self.robot, self.graph, self.views, self.predictor, self.method, np.random.default_rng(0))

    def go(self, goal: NodeId, query: int = 0, navigator: Navigator | None = None) -> tuple[Episode, list[Event]]:
        events: list[Event] = []
        episode = run_episode(
            navigator or self.navigator(),
            goal,
            query,
            advance=self.robot.advance,
            verdict=lambda: judge(query, self.robot.pose, self.poses[goal]),
            consume=events.append,
        )
        return episode, events

    def nearest(self, x: float, y: float) -> NodeId:
        return min(self.graph.nodes, key=lambda node: math.dist(self.poses[node][:2], (x, y)))


def mapped(world: FlatWorld, images: list[Observation], method: Method, *, drift: float = 0.0) -> Place:
    predictor = FlatPredictor(world)
    views = Views(predictor)
    graph = TopologicalGraph(build(images, views, predictor, method, np.random.default_rng(0)))
    poses = {seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None}
    robot = FlatRobot(world, poses[images[0].step].tolist(), first_step=FIRST_STEP, drift=drift)
    return Place(world, robot, graph, views, predictor, method, poses)


def rooms(method: Method, **options: float) -> Place:
    return mapped(two_rooms(), list(tour(WAY)), method, **options)


def corridor(method: Method, *, lie: bool = False) -> Place:
    """Return a map of seven nodes in a row in one room, 0.6 m apart, and beside them nothing."""
    images = [look_at(np.array([0.6 + 0.6 * k, 1.0, 0.0]), k) for k in range(7)]
    place = mapped(one_room(), images[:1], method)
    for seen in images[1:]:
        place.views.add([seen])
        place.graph.apply(NodeAdded(node_of(seen), Cause.BUILD))
        for source, target, dx in ((seen.step - 1, seen.step, 0.6), (seen.step, seen.step - 1, -0.6)):
            join(place, source, target, dx)
    place.poses.update({seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None})
    return place


def join(place: Place, source: NodeId, target: NodeId, dx: float) -> None:
    belief = initial(0.9, abs(dx), place.method.believing)
    place.graph.apply(EdgeAdded(Edge(source, target, PoseRow(dx, 0.0, 0.0), belief), Cause.BUILD))


def of(kind: type, events: list[Event]) -> list:
    return [event for event in events if isinstance(event, kind)]


@PRESETS
def test_random_goals_in_two_rooms_are_reached(method: Method) -> None:
    place = rooms(method, drift=0.03)
    goals = random_goals(list(place.graph.nodes), 12, np.random.default_rng(1))
    navigator = place.navigator()
    reached = [place.go(goal, query, navigator)[0].reached for query, goal in enumerate(goals)]
    assert all(reached)
    assert place.robot.collisions == 0


def test_the_events_tell_the_story_in_order() -> None:
    place = rooms(ROBUST)
    goal = place.nearest(5.2, 3.2)
    episode, events = place.go(goal, query=7)
    assert events[0] == QueryStarted(7, goal)
    assert episode.ended == of(QueryEnded, events)[0]
    assert episode.ended.outcome is Outcome.ARRIVED
    assert events[-1] == episode.judged
    kinds = [type(event) for event in events if not isinstance(event, StateChanged | GraphChanged)]
    for k, kind in enumerate(kinds):
        if kind is LegStarted:
            assert kinds[k - 2 : k] == [Localised, Planned]
            assert kinds[k + 1] is LegEnded
    legs = of(LegStarted, events)
    assert [leg.attempt for leg in legs] == list(range(1, len(legs) + 1))
    assert episode.ended.steps == place.robot.step - FIRST_STEP
    assert episode.ended.path_m > 3


def test_the_robot_backs_up_along_an_edge_driven_against_its_direction() -> None:
    place = corridor(replace(ROBUST, driving=replace(ROBUST.driving, back_up_clearance_m=0.0)))
    place.robot.pose = np.array([3.0, 1.0, 0.0])
    twists = []
    for event in place.navigator().query(1, 0):
        if isinstance(event, Tick):
            twists.append(place.robot.twist.linear_m_s)
            place.robot.advance()
    assert judge(0, place.robot.pose, place.poses[1]).reached
    assert min(twists) < 0
    assert max(twists) <= 0


def test_what_was_driven_is_believed_more() -> None:
    place = corridor(ROBUST)
    before = dict(place.graph.edges)
    _, events = place.go(4)
    driven = [(leg.source, leg.target) for leg in of(LegEnded, events) if leg.source is not None and leg.succeeded]
    assert driven
    for edge in driven:
        assert place.graph.edges[edge].belief.p > before[edge].belief.p
        assert place.graph.edges[edge].successes == 1


def test_every_change_of_the_map_is_told() -> None:
    place = rooms(ROBUST)
    start, history = place.graph.copy(), []
    navigator = place.navigator()
    for query, goal in enumerate(random_goals(list(place.graph.nodes), 4, np.random.default_rng(2))):
        history += [event.delta for event in of(GraphChanged, place.go(goal, query, navigator)[1])]
    for delta in history:
        start.apply(delta)
    assert start == place.graph


@PRESETS
def test_a_frozen_map_stays_as_it_is(method: Method) -> None:
    place = rooms(replace(method, maintain=False))
    before = place.graph.copy()
    episode, _ = place.go(place.nearest(5.2, 3.2))
    assert episode.reached
    assert place.graph == before


def walled_off(place: Place) -> None:
    """Put a wall between the third and the fourth node that the predictor does not know of."""
    wall = np.array([[[2.1, 0.0], [2.1, 4.0]]])
    place.robot.world = FlatWorld(np.concatenate([place.world.walls, wall]))


def drive_at_the_wall(method: Method, queries: int = 5) -> Place:
    """Send the robot along a corridor that a wall has closed, again and again."""
    place = corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=3, step_limit=400)))
    walled_off(place)
    for query in range(queries):
        place.robot.pose = np.array([0.6, 1.0, 0.0])
        assert not place.go(5, query)[0].reached
    assert place.robot.collisions > 0
    return place


def test_an_edge_that_is_blocked_leaves_the_map_after_repeats() -> None:
    # What hinders the robot says little of the edge, so it takes many queries.
    assert (2, 3) not in drive_at_the_wall(ROBUST, queries=30).graph.edges


def test_the_literal_method_takes_a_blocked_edge_for_a_success_while_its_end_is_in_sight() -> None:
    place = drive_at_the_wall(PAPER, queries=2)
    assert place.graph.edges[2, 3].successes == place.graph.edges[2, 3].attempts > 1


def test_the_robust_method_prunes_no_edge_in_its_first_query() -> None:
    place = corridor(replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=400)))
    walled_off(place)
    _, events = place.go(5)
    assert not [event for event in of(GraphChanged, events) if isinstance(event.delta, EdgePruned)]
    assert place.graph.edges[2, 3].attempts == 1


def test_a_wormhole_is_avoided_for_the_rest_of_the_query_and_then_pruned() -> None:
    place = corridor(ROBUST)
    join(place, 0, 6, 0.5)
    place.predictor.lies[(FIRST_STEP, 6)] = np.array([0.5, 0.0, 0.0])
    for query in range(3):
        place.robot.pose = np.array([0.6, 1.0, 0.0])
        place.robot.step = FIRST_STEP
        episode, events = place.go(6, query)
        assert episode.reached
        if query == 0:
            assert (of(LegStarted, events)[0].source, of(LegStarted, events)[0].target) == (0, 6)
    assert (0, 6) not in place.graph.edges


def test_a_map_cut_in_two_is_joined_through_the_reserve() -> None:
    place = rooms(ROBUST)
    left = {node for node in place.graph.nodes if place.poses[node][0] < 3.0}
    for source, target in list(place.graph.edges):
        if (source in left) != (target in left):
            place.graph.apply(EdgePruned(source, target, Cause.HAND))
    goal = place.nearest(5.2, 3.2)
    episode, events = place.go(goal)
    assert episode.reached
    causes = {event.delta.cause for event in of(GraphChanged, events)}
    assert Cause.EXPAND in causes


@PRESETS
def test_where_no_path_exists_the_query_ends_and_says_so(method: Method) -> None:
    place = corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=5)))
    place.graph.apply(NodeDropped(3, Cause.HAND))
    episode, events = place.go(6)
    assert episode.ended.outcome is Outcome.NO_PATH
    assert episode.ended.steps < 200
    assert of(Planned, events)[0].nodes == ()
    assert of(Planned, events)[0].cost == math.inf


@PRESETS
def test_a_lost_robot_turns_looks_and_gives_up(method: Method) -> None:
    place = corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=8)))
    place.robot.pose = np.array([2.0, 3.5, math.pi / 2])
    place.predictor.sight_m = 0.3
    episode, events = place.go(6)
    assert episode.ended.outcome is Outcome.LOST
    assert all(event.node is None for event in of(Localised, events))
    assert abs(place.robot.pose[2] - math.pi / 2) > 0.1


def test_a_lost_robot_that_turns_far_enough_finds_itself() -> None:
    place = corridor(ROBUST)
    place.robot.pose = np.array([0.7, 1.0, math.pi])
    assert place.go(4)[0].reached


def test_what_a_lost_robot_sees_becomes_a_node() -> None:
    place = corridor(PAPER)
    place.robot.pose = np.array([0.6, 1.0, 0.9])
    place.method = replace(PAPER, localising=replace(PAPER.localising, distance=0.5))
    place.method = replace(place.method, building=replace(PAPER.building, connect_distance=1.2))
    episode, events = place.go(4)
    added = [event.delta for event in of(GraphChanged, events) if isinstance(event.delta, NodeAdded)]
    assert added
    assert added[0].cause is Cause.NOVEL
    assert added[0].node.id in place.graph.nodes
    assert added[0].node.id in place.views
    assert episode.reached


@PRESETS
def test_a_query_never_outlasts_its_limits(method: Method) -> None:
    limits = replace(method.recovering, step_limit=150, give_up_after_looks=10_000)
    place = corridor(replace(method, recovering=limits))
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
    place = corridor(replace(method, recovering=replace(method.recovering, step_limit=300)))

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


def test_too_many_touches_end_the_query() -> None:
    recovering = replace(PAPER.recovering, collision_limit=3)
    place = corridor(replace(PAPER, recovering=recovering, maintain=False))
    walled_off(place)
    episode, events = place.go(5)
    assert episode.ended.outcome is Outcome.COLLISION_LIMIT
    assert [event.count for event in of(Collided, events)] == [1, 2, 3, 4]


def test_the_depth_image_stops_the_robot_before_it_touches() -> None:
    place = corridor(replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=200)))
    wall_x = 2.1

    class Seeing(FlatRobot):
        def observe(self) -> Observation:
            seen, away = super().observe(), (wall_x - self.pose[0]) / max(math.cos(self.pose[2]), 0.05)
            depth = np.full((72, 96), max(0.05, away) if abs(self.pose[2]) < 1.2 else 5.0, np.float32)
            return replace(seen, depth=depth)

    place.robot = Seeing(place.world, [0.6, 1.0, 0.0], first_step=FIRST_STEP)
    walled_off(place)
    _, events = place.go(5)
    assert place.robot.collisions == 0
    assert LegEnd.BLOCKED in {leg.end for leg in of(LegEnded, events)}
    assert place.robot.pose[0] < wall_x - 0.18


@pytest.mark.parametrize("ticks", [0, 1, 5, 40])
def test_closing_a_query_stops_the_robot(ticks: int) -> None:
    place = rooms(ROBUST)
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
    place = rooms(ROBUST)
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
    place = rooms(ROBUST)
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
    assert of(LegEnded, events)[-1].end is LegEnd.CANCELLED
    navigator.cancel()  # Between queries there is nothing to cancel.
    assert place.go(place.nearest(0.8, 0.8), 1, navigator)[0].reached


def test_a_goal_that_is_not_in_the_map_is_refused_at_once() -> None:
    place = corridor(ROBUST)
    with pytest.raises(MapError, match="Node 77 is not in the map, which has 7 nodes"):
        place.navigator().query(77, 0)


def test_a_robot_that_starts_at_the_goal_has_arrived() -> None:
    place = corridor(ROBUST)
    episode, events = place.go(0)
    assert episode.reached
    assert of(LegStarted, events) == []


@PRESETS
def test_the_navigator_never_reads_the_exact_pose(method: Method) -> None:
    place = corridor(method)

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


def test_a_lifelong_run_counts_what_happened() -> None:
    place = rooms(ROBUST)
    goals = random_goals(list(place.graph.nodes), 5, np.random.default_rng(3))
    lifelong = Lifelong()
    episodes = list(
        lifelong.run(
            place.navigator(),
            goals,
            first_query=10,
            advance=place.robot.advance,
            verdict=lambda query, goal: judge(query, place.robot.pose, place.poses[goal]),
        )
    )
    tally = lifelong.tally()
    assert [episode.ended.query for episode in episodes] == [10, 11, 12, 13, 14]
    assert (tally.queries, tally.reached, tally.collisions) == (5, 5, 0)
    assert tally.steps == sum(episode.ended.steps for episode in episodes)


def test_goals_never_repeat_at_once_and_need_a_map() -> None:
    goals = random_goals([1, 2, 3], 50, np.random.default_rng(0))
    assert all(a != b for a, b in itertools.pairwise(goals))
    assert random_goals([4], 2, np.random.default_rng(0)) == (4, 4)
    with pytest.raises(MapError, match="no nodes to go to"):
        random_goals([], 1, np.random.default_rng(0))


def test_the_verdict_is_the_papers() -> None:
    goal = np.array([1.0, 1.0, 3.1])
    assert judge(0, np.array([1.5, 1.5, -3.1]), goal).reached  # 0.71 m, and the yaw wraps.
    assert not judge(0, np.array([1.52, 1.52, 3.1]), goal).reached
    assert not judge(0, np.array([1.0, 1.0, 2.6]), goal).reached
