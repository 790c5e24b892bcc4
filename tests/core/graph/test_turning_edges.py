"""Where the robot may turn on the spot, and where it may not."""

import itertools

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import Cause, EdgeAdded, GraphDelta, NodeAdded
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import bidirectional_edges, node_from_observation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.graph.turning_edges import turning_edges
from ltvn_core.types import Observation
from tests.core.flat_world import observation_at

AHEAD = np.array([0.6, 0.0, 0.0])


def there_and_back(aside_m: float = 0.2, count: int = 6) -> list[Observation]:
    """Return pictures of a way and of the way back beside it."""
    out = [np.array([0.6 * k, 0.0, 0.0]) for k in range(count)]
    back = [np.array([0.6 * k, aside_m, np.pi]) for k in reversed(range(count))]
    return [observation_at(pose, 10 * k) for k, pose in enumerate([*out, *back])]


def chain(images: list[Observation]) -> TopologicalGraph:
    """Return a map whose edges join the pictures in a row."""
    deltas: list[GraphDelta] = [NodeAdded(node_from_observation(images[0]), Cause.BUILD)]
    for last, seen in itertools.pairwise(images):
        waypoint = np.array([[-0.6, 0.0, 0.0]])
        matches = Matches((last.step,), np.array([0.9]), waypoint, np.array([0.6]), np.ones(1, bool))
        deltas.append(NodeAdded(node_from_observation(seen), Cause.BUILD))
        deltas += bidirectional_edges(seen.step, matches, ROBUST.believing, Cause.BUILD)
    return TopologicalGraph(deltas)


def turns(images: list[Observation], gate: OdometryGate | None = None) -> list[EdgeAdded]:
    gate = gate or OdometryGate(images, ROBUST.building)
    return list(turning_edges(chain(images), gate, ROBUST))


def test_nodes_side_by_side_that_look_opposite_ways_are_joined_both_ways_where_the_way_round_is_long() -> None:
    images = there_and_back(count=8)
    edges = {(added.edge.source, added.edge.target): added.edge for added in turns(images)}
    assert (0, 150) in edges
    there, back = np.array(edges[0, 150].waypoint), np.array(edges[150, 0].waypoint)
    assert np.allclose(np.abs(there), [0.0, 0.2, np.pi])
    assert np.allclose(compose(there, back), 0, atol=1e-9)


def test_where_the_way_round_is_short_nothing_is_added() -> None:
    edges = {(added.edge.source, added.edge.target) for added in turns(there_and_back())}
    assert (50, 60) not in edges
    assert len(edges) <= 2 * 2


def test_where_a_wall_may_be_between_two_nodes_they_are_not_joined() -> None:
    assert turns(there_and_back(aside_m=0.5, count=8)) == []


def test_where_odometry_may_be_wrong_by_now_nodes_are_not_joined() -> None:
    long_way = [observation_at(np.array([12.0 - abs(12.0 - 0.6 * k), 0.0, 0.0]), 10 * k) for k in range(41)]
    far = {abs(added.edge.source - added.edge.target) for added in turns(long_way)}
    assert max(far, default=0) * 0.06 <= 10.0
