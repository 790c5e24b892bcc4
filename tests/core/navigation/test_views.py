"""A robot that drives through places which look different today, and knows them by odometry."""

from dataclasses import dataclass, field, replace

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import ViewAdded, ViewUsed
from ltvn_core.graph.node_views import ViewConfig
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, QueryEnded
from ltvn_core.types import Prediction
from tests.core.flat_world import FlatPredictor
from tests.core.navigation.mapped_world import FIRST_STEP, events_of
from tests.core.navigation.sighted_world import DoorWorld, door_world

CHANGED_M = (1.4, 2.2)
"""The stretch of the way, in x, that looks different today."""


@dataclass
class RepaintedPredictor(FlatPredictor):
    """Does not see that an image of today and one of the mapping drive show the same place, where that was painted."""

    painted: tuple[float, float] = field(default=CHANGED_M)

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> Prediction:
        answer = super().predict(sources, targets)
        first, second = np.broadcast_arrays(sources, targets)
        painted = [(self.painted[0] < each[:, 0]) & (each[:, 0] < self.painted[1]) for each in (first, second)]
        today = [each[:, 3] >= FIRST_STEP for each in (first, second)]
        answer.reachability[(painted[0] | painted[1]) & (today[0] != today[1])] = 0.05
        return answer


NODE_BY_NODE = replace(ROBUST, building=replace(ROBUST.building, floor_edges=False))
"""Passes every node, where a long edge over free floor would pass by what was painted."""


def repainted_world(maintenance: str = "persistent") -> DoorWorld:
    place = door_world(maintenance, method=NODE_BY_NODE)
    place.predictor = RepaintedPredictor(place.world)
    return place


def drive(place: DoorWorld, query: int, goal: int) -> list[Event]:
    place.put(0.8, 1.0)
    place.wait(60.0)
    return place.go(goal, query)[1]


def changes(kind: type, events: list[Event]) -> list:
    return [each.delta for each in events_of(GraphChanged, events) if isinstance(each.delta, kind)]


def test_a_place_that_looks_different_gets_views_that_are_used_the_next_time() -> None:
    place = repainted_world()
    goal = place.nearest(3.4, 1.0)
    added = changes(ViewAdded, [event for query in range(3) for event in drive(place, query, goal)])
    assert added
    for delta in added:
        truth = relative(
            place.poses[delta.node], np.array(place.keyframes.features([delta.view.frame])[0, :3], np.float64)
        )
        assert np.abs(np.array(delta.view.pose) - truth).max() < 0.1
        assert np.hypot(*truth[:2]) < ViewConfig().distance
    assert changes(ViewUsed, [event for query in range(3, 6) for event in drive(place, query, goal)])
    assert max(map(len, place.graph.views.values())) <= ViewConfig().most


class BlindPredictor(RepaintedPredictor):
    """Has, where the world was painted, no idea where the other image was taken either."""

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> Prediction:
        answer = super().predict(sources, targets)
        answer.waypoints[answer.reachability < 0.1] = 1.5, -0.5, 2.0
        return answer


def test_a_goal_whose_image_can_say_nothing_is_reached_where_the_way_there_is_sure() -> None:
    place = door_world("paper")
    goal = place.nearest(3.4, 1.0)
    place.predictor = BlindPredictor(place.world, painted=(3.0, 3.8))

    ended = events_of(QueryEnded, drive(place, 0, goal))

    assert [each.outcome for each in ended] == [Outcome.ARRIVED]
    assert np.hypot(*(place.robot.pose - place.poses[goal])[:2]) < 0.3


def test_where_nothing_changed_no_views_come_in() -> None:
    place = door_world()
    for query in range(2):
        drive(place, query, place.nearest(5.2, 1.0))
    assert not place.graph.views


def test_the_maintenance_of_the_paper_takes_no_views() -> None:
    place = repainted_world("paper")
    goal = place.nearest(3.4, 1.0)
    for query in range(2):
        drive(place, query, goal)
    assert not place.graph.views
