"""While somebody drives, the coach says what the map lacks and where to go next."""

import numpy as np
import pytest

from ltvn_core.analysis.map_findings import MapFinding, map_findings, one_sided_places, unclosed_loops
from ltvn_core.config import ROBUST
from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from tests.core.flat_world import FlatPredictor, one_room, tour

STEPS_M = 0.5


def ring(sides: int = 4, side_m: float = 4.0, *, laps: float = 1.1) -> np.ndarray:
    """Poses (T, 3) every half metre round a square, a little more than once."""
    per_side = int(side_m / STEPS_M)
    poses, pose = [], np.zeros(3)
    for k in range(int(laps * sides * per_side)):
        poses.append(pose.copy())
        pose[:2] += STEPS_M * np.array([np.cos(pose[2]), np.sin(pose[2])])
        if k % per_side == per_side - 1:
            pose[2] = wrap_angle(pose[2] + np.pi / 2)
    return np.array(poses)


def chain(poses: np.ndarray, *, gaps: tuple[int, ...] = ()) -> TopologicalGraph:
    """A node at each pose, joined both ways to the one before, but not across the gaps."""
    graph = TopologicalGraph(
        NodeAdded(Node(k, PoseRow(*map(float, pose))), Cause.ONLINE) for k, pose in enumerate(poses)
    )
    for k in range(1, len(poses)):
        if k not in gaps:
            join(graph, k - 1, k)
    return graph


def join(graph: TopologicalGraph, a: int, b: int) -> None:
    for source, target in ((a, b), (b, a)):
        graph.apply(EdgeAdded(Edge(source, target, PoseRow(0.5, 0, 0), Belief(0.9, 0.5, 0.02)), Cause.ONLINE))


def coached(graph: TopologicalGraph, poses: np.ndarray) -> tuple[MapFinding, ...]:
    return map_findings(graph, range(len(poses)), poses)


def loops(graph: TopologicalGraph, poses: np.ndarray) -> list[tuple[EdgeKey, float]]:
    return [pair for each in unclosed_loops(graph, range(len(poses)), poses) for pair in each.pairs]


def test_a_loop_that_was_driven_but_not_closed_is_found_until_an_edge_closes_it() -> None:
    poses = ring()
    graph = chain(poses)
    (((first, second), gap_m),) = loops(graph, poses)  # The overlap is 1.5 m long, and a place is counted once.
    assert (first - second, gap_m) == (32, pytest.approx(0, abs=1e-6))
    advice = coached(graph, poses)[0]
    assert "no edge joins them" in advice.finding.text
    assert advice.target == graph.nodes[first].odometry
    join(graph, 0, 32)
    assert loops(graph, poses) == []


def test_pieces_come_first_and_the_way_to_the_other_one_is_told() -> None:
    poses = np.array([[0.5 * k, 0.0, 0.0] for k in range(10)])
    graph = chain(poses, gaps=(5,))
    first = coached(graph, poses)[0]
    assert first.nodes == (5, 6, 7, 8, 9)
    assert first.target == graph.nodes[4].odometry
    assert first.finding.remedy.startswith("Drive to node 4, 2.5 m away behind you")
    assert "2 pieces" in first.finding.text


def test_a_fact_without_a_remedy_comes_last() -> None:
    poses = np.array([[0.5 * k, 0.0, 0.0] for k in range(10)])
    assert "one piece" in coached(chain(poses), poses)[-1].finding.text


def test_a_place_seen_from_one_side_asks_to_be_seen_from_the_other() -> None:
    poses = np.array([[0.2 * k, 0.0, 0.1] for k in range(15)])
    targets = [each.target for each in one_sided_places(poses)]
    assert len(targets) == 3
    assert targets[0] == coached(chain(poses), poses)[0].target
    assert all(target is not None and target.yaw_rad == pytest.approx(0.1 - np.pi) for target in targets)
    back = np.concatenate([poses, poses[::-1] + np.array([0.0, 0.0, np.pi - 0.2])])
    assert one_sided_places(back) == ()


def test_yaws_on_both_sides_of_half_a_turn_are_one_side() -> None:
    poses = np.array([[0.1, 0.1, sign * 3.1] for sign in (1, -1, 1, -1)])
    (place,) = one_sided_places(poses)
    assert place.target is not None
    assert place.target.yaw_rad == pytest.approx(0.0)


def test_an_image_is_as_new_as_the_network_says() -> None:
    predictor = FlatPredictor(one_room())
    drive = list(tour([(1.0, 1.0), (2.5, 1.0)]))
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(drive, keyframes, predictor, ROBUST, np.random.default_rng(0)))
    matcher, nodes = Matcher(predictor, keyframes, ROBUST.matching), tuple(graph.nodes)
    steps, poses = [seen.step for seen in drive], np.array([seen.odometry for seen in drive])
    known = map_findings(graph, steps, poses, matcher.match(predictor.encode([drive[5]]), nodes))
    assert "one side only" in known[0].finding.text
    assert any("5% new" in each.finding.text for each in known[1:])
    strange = predictor.encode([drive[5]]) + np.array([2.4, 2.0, 0.0, 0.0])
    new = map_findings(graph, steps, poses, matcher.match(strange, nodes))
    assert "95% new" in new[0].finding.text


def test_where_no_drive_mends_anything_the_rim_is_next() -> None:
    poses = np.array([[0.2 * k, 0.5, np.pi * (k % 2)] for k in range(20)])
    contradicted = chain(poses)
    contradicted.apply(EdgeAdded(Edge(0, 2, PoseRow(6, 0, 0), Belief(0.9, 6, 0.02)), Cause.ONLINE))
    for graph, place in ((chain(poses), 0), (contradicted, 1)):
        advice = coached(graph, poses)[place]
        assert "beyond what you have seen, right where you are" in str(advice.finding)
        assert advice.target is not None
        assert advice.target.x_m in (0.0, pytest.approx(3.8))


def test_before_anything_was_driven_the_hint_is_to_drive() -> None:
    (advice,) = map_findings(TopologicalGraph(), [], np.empty((0, 3)))
    assert (advice.target, advice.pairs, advice.nodes) == (None, (), ())


def test_nodes_from_an_older_drive_are_another_visit() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    graph = TopologicalGraph(NodeAdded(Node(k, PoseRow(0.1, 0.0, 0.0)), Cause.LOAD) for k in (0, 900))
    assert len(unclosed_loops(graph, [900, 950], poses)) == 1
    assert len(unclosed_loops(graph, [], np.empty((0, 3)))) == 1


def test_many_rounds_and_a_long_way_are_counted_right() -> None:
    poses = ring(laps=15)
    graph = chain(poses)
    assert strongly_connected_components(graph) == (tuple(range(480)),)
    assert loops(graph, poses)
    assert all(abs(first - second) % 32 in (0, 1, 31) for (first, second), _ in loops(graph, poses))
    long = np.array([[0.5 * k, 0.0, 0.0] for k in range(2000)])
    assert loops(chain(long), long) == []
