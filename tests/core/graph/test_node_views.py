"""Places that change their looks: views are compared where a node is not recognised, and the least useful goes."""

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import Cause, NodeAdded, NodeView, PoseRow, ViewAdded, ViewDropped, ViewUsed
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localiser
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.node_views import ViewConfig, view_deltas
from ltvn_core.graph.operators import node_from_observation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Prediction, Waypoint
from tests.core.flat_world import FlatPredictor, observation_at, one_room

NODES = [observation_at(np.array([1.0 + 2.5 * k, 1.0, 0.0]), k) for k in range(2)]
VIEW = observation_at(np.array([3.3, 1.1, 0.0]), 50)
"""Taken 0.2 m behind the second node and 0.1 m to its left."""
HERE = observation_at(np.array([3.4, 1.0, 0.0]), 99)
DAY_S = 86400.0


def graph_with(*views: NodeView) -> TopologicalGraph:
    deltas = [NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in NODES]
    return TopologicalGraph([*deltas, *(ViewAdded(1, view, Cause.SIGHT) for view in views)])


class ChangedLooks(FlatPredictor):
    """Recognises no node from where the robot is now, but images of today by each other."""

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> Prediction:
        answer = super().predict(sources, targets)
        first, second = np.broadcast_arrays(sources[:, 3], targets[:, 3])
        answer.reachability[(first >= 50) != (second >= 50)] = 0.1
        return answer


def localised(graph: TopologicalGraph, config: ViewConfig | None) -> tuple[int | None, int | None, Waypoint]:
    predictor = ChangedLooks(one_room())
    keyframes = KeyframeStore(predictor)
    keyframes.add([*NODES, VIEW])
    matcher = Matcher(predictor, keyframes, ROBUST.matching, views=graph.views, view_config=config)
    found = Localiser(matcher, ROBUST.localising).localise(predictor.encode([HERE]), graph)
    return found.node, found.view, found.waypoint


def test_a_place_that_looks_different_is_recognised_by_its_view_and_lies_where_its_node_does() -> None:
    graph = graph_with(NodeView(50, PoseRow(-0.2, 0.1, 0.0), 0.0))
    node, view, waypoint = localised(graph, ViewConfig())
    assert (node, view) == (1, 50)
    assert waypoint == pytest.approx([0.1, 0.0, 0.0], abs=1e-6)


def test_without_views_or_without_their_use_the_robot_is_lost_there() -> None:
    assert localised(graph_with(), ViewConfig())[0] is None
    assert localised(graph_with(NodeView(50, PoseRow(-0.2, 0.1, 0.0), 0.0)), None)[0] is None


def test_a_node_that_is_recognised_is_not_asked_for_its_views() -> None:
    graph = graph_with(NodeView(50, PoseRow(9.0, 9.0, 0.0), 0.0))
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    keyframes.add([*NODES, VIEW])
    plain = Matcher(predictor, keyframes, ROBUST.matching)
    viewing = Matcher(predictor, keyframes, ROBUST.matching, views=graph.views, view_config=ViewConfig())
    here = predictor.encode([HERE])
    assert viewing.match(here, (1,)).waypoints == pytest.approx(plain.match(here, (1,)).waypoints)
    assert not viewing.match(here, (0, 1)).by_view.any()


def test_a_node_keeps_the_views_that_are_used() -> None:
    graph = graph_with(*(NodeView(frame, PoseRow(0.0, 0.0, 0.0), 0.0) for frame in (50, 51)))
    graph.apply(ViewUsed(1, 50, 10.0, Cause.SIGHT))
    fresh = NodeView(52, PoseRow(0.0, 0.0, 0.0), 20.0)
    dropped, added = view_deltas(graph.views, 1, fresh, ViewConfig())
    assert dropped == ViewDropped(1, 51, Cause.SIGHT)
    for delta in (dropped, added):
        graph.apply(delta)
    assert [view.frame for view in graph.views[1]] == [50, 52]
    assert graph.views[1][0].uses == 1


def test_a_view_that_was_used_long_ago_makes_room_for_one_of_today() -> None:
    old = NodeView(50, PoseRow(0.0, 0.0, 0.0), 0.0, uses=5)
    young = NodeView(51, PoseRow(0.0, 0.0, 0.0), 9 * DAY_S, uses=1)
    fresh = NodeView(52, PoseRow(0.0, 0.0, 0.0), 10 * DAY_S)
    assert view_deltas(graph_with(old, young).views, 1, fresh, ViewConfig())[0] == ViewDropped(1, 50, Cause.SIGHT)
