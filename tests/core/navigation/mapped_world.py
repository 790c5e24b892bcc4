"""A flat world with its map and its robot, in which navigation is tried. Holds no test."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached, run_query
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.operators import initial_belief, node_from_observation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Event
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.types import NodeId, Observation, Pose
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, observation_at, one_room, tour, two_rooms

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
WAY = [(0.8, 0.8), (2.3, 0.8), (2.3, 2.0), (3.8, 2.0), (5.2, 0.8), (5.2, 3.2), (3.8, 2.0), (2.2, 2.0), (0.8, 3.2)]
FIRST_STEP = 100_000


@dataclass
class MappedWorld:
    """A world with a map of it and a robot in it."""

    world: FlatWorld
    robot: FlatRobot
    graph: TopologicalGraph
    keyframes: KeyframeStore
    predictor: FlatPredictor
    method: Method
    poses: dict[NodeId, Pose]

    def navigator(self) -> Navigator:
        system, rng = ltvn_system(self.method), np.random.default_rng(0)
        return Navigator(self.robot, self.graph, self.keyframes, self.predictor, system, rng)

    def go(self, goal: NodeId, query: int = 0, navigator: Navigator | None = None) -> tuple[QueryResult, list[Event]]:
        events: list[Event] = []
        episode = run_query(
            navigator or self.navigator(),
            goal,
            query,
            advance=self.robot.advance,
            verdict=lambda: judge_goal_reached(query, self.robot.pose, self.poses[goal]),
            consume=events.append,
        )
        return episode, events

    def nearest(self, x: float, y: float) -> NodeId:
        known = (node for node in self.graph.nodes if node in self.poses)
        return min(known, key=lambda node: math.dist(self.poses[node][:2], (x, y)))


def map_world(
    world: FlatWorld,
    images: list[Observation],
    method: Method,
    *,
    drift: float = 0.0,
    predictor: FlatPredictor | None = None,
) -> MappedWorld:
    predictor = predictor or FlatPredictor(world)
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(images, keyframes, predictor, method, np.random.default_rng(0)))
    poses = {seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None}
    robot = FlatRobot(world, poses[images[0].step].tolist(), first_step=FIRST_STEP, drift=drift)
    return MappedWorld(world, robot, graph, keyframes, predictor, method, poses)


@cache
def _known_rooms(method: Method) -> MappedWorld:
    """Return the map that all tests of two rooms begin with; nobody may change it."""
    return map_world(two_rooms(), list(tour(WAY)), method)


def mapped_rooms(method: Method, *, drift: float = 0.0) -> MappedWorld:
    """Return two rooms with a map and a robot of this test's own."""
    known = _known_rooms(method)
    world, predictor = two_rooms(), FlatPredictor(two_rooms())
    keyframes = KeyframeStore(predictor)
    keyframes.add([known.keyframes.observation(frame) for frame in known.keyframes.frames])
    robot = FlatRobot(world, known.robot.pose.tolist(), first_step=FIRST_STEP, drift=drift)
    return MappedWorld(world, robot, known.graph.copy(), keyframes, predictor, method, dict(known.poses))


def mapped_corridor(method: Method, *, lie: bool = False) -> MappedWorld:
    """Return a map of seven nodes in a row in one room, 0.6 m apart, and beside them nothing."""
    images = [observation_at(np.array([0.6 + 0.6 * k, 1.0, 0.0]), k) for k in range(7)]
    place = map_world(one_room(), images[:1], method)
    for seen in images[1:]:
        place.keyframes.add([seen])
        place.graph.apply(NodeAdded(node_from_observation(seen), Cause.BUILD))
        for source, target, dx in ((seen.step - 1, seen.step, 0.6), (seen.step, seen.step - 1, -0.6)):
            join_nodes(place, source, target, dx)
    place.poses.update({seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None})
    return place


def join_nodes(place: MappedWorld, source: NodeId, target: NodeId, dx: float) -> None:
    belief = initial_belief(0.9, abs(dx), place.method.believing)
    place.graph.apply(EdgeAdded(Edge(source, target, PoseRow(dx, 0.0, 0.0), belief), Cause.BUILD))


def events_of(kind: type, events: list[Event]) -> list:
    return [event for event in events if isinstance(event, kind)]


def block_corridor(place: MappedWorld) -> None:
    """Put a wall between the third and the fourth node that the predictor does not know of."""
    wall = np.array([[[2.1, 0.0], [2.1, 4.0]]])
    place.robot.world = FlatWorld(np.concatenate([place.world.walls, wall]))
