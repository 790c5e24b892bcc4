"""A flat world with its map and its robot, in which navigation is tried. Holds no test."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.graph.beliefs import initial
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, NodeAdded, PoseRow
from ltvn_core.graph.operators import node_of
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.nav.episode import Episode, judge, run_episode
from ltvn_core.nav.events import Event
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


def walled_off(place: Place) -> None:
    """Put a wall between the third and the fourth node that the predictor does not know of."""
    wall = np.array([[[2.1, 0.0], [2.1, 4.0]]])
    place.robot.world = FlatWorld(np.concatenate([place.world.walls, wall]))
