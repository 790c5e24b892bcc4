"""While somebody drives, the coach says what the map lacks and where to go next."""

import numpy as np
import pytest

from ltvn_core.analysis.mapping_advice import (
    MappingAdvice,
    advise_mapping,
    find_missing_loop_closures,
    one_sided_places,
)
from ltvn_core.config import ROBUST
from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.builder import build
from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
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


def coached(graph: TopologicalGraph, poses: np.ndarray) -> MappingAdvice:
    return advise_mapping(graph, range(len(poses)), poses)


def test_a_loop_that_was_driven_but_not_closed_is_found_until_an_edge_closes_it() -> None:
    poses = ring()
    graph = chain(poses)
    advice = coached(graph, poses)
    assert len(advice.missing_closures) == 1  # The overlap is 1.5 m long, and a place is counted once.
    assert all(
        loop.first - loop.second == 32 and loop.gap_m == pytest.approx(0, abs=1e-6) for loop in advice.missing_closures
    )
    assert "no edge joins them" in advice.hint.text
    assert advice.target in [graph.nodes[loop.first].odometry for loop in advice.missing_closures]
    join(graph, 0, 32)
    assert coached(graph, poses).missing_closures == ()


def test_pieces_come_first_and_the_way_to_the_other_one_is_told() -> None:
    poses = np.array([[0.5 * k, 0.0, 0.0] for k in range(10)])
    graph = chain(poses, gaps=(5,))
    advice = coached(graph, poses)
    assert advice.strongly_connected_components == ((0, 1, 2, 3, 4), (5, 6, 7, 8, 9))
    assert advice.target == graph.nodes[4].odometry
    assert advice.hint.remedy.startswith("Drive to node 4, 2.5 m away behind you")
    assert "2 pieces" in advice.hint.text


def test_a_place_seen_from_one_side_asks_to_be_seen_from_the_other() -> None:
    poses = np.array([[0.2 * k, 0.0, 0.1] for k in range(15)])
    places = one_sided_places(poses)
    assert sum(place.images for place in places) == 15
    assert all(abs(place.yaw_rad) < np.pi / 8 for place in places)
    target = coached(chain(poses), poses).target
    assert target is not None
    assert target.yaw_rad == pytest.approx(0.1 - np.pi)
    back = np.concatenate([poses, poses[::-1] + np.array([0.0, 0.0, np.pi - 0.2])])
    assert one_sided_places(back) == ()


def test_yaws_on_both_sides_of_half_a_turn_are_one_side() -> None:
    poses = np.array([[0.1, 0.1, sign * 3.1] for sign in (1, -1, 1, -1)])
    (place,) = one_sided_places(poses)
    assert abs(place.yaw_rad) == pytest.approx(np.pi)


def test_an_image_is_as_new_as_the_network_says() -> None:
    predictor = FlatPredictor(one_room())
    drive = list(tour([(1.0, 1.0), (2.5, 1.0)]))
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(drive, keyframes, predictor, ROBUST, np.random.default_rng(0)))
    matcher, nodes = Matcher(predictor, keyframes, ROBUST.matching), tuple(graph.nodes)
    steps, poses = [seen.step for seen in drive], np.array([seen.odometry for seen in drive])
    known = advise_mapping(graph, steps, poses, matcher.match(predictor.encode([drive[5]]), nodes))
    assert known.novelty == pytest.approx(0.05)
    assert "one side only" in known.hint.text
    strange = predictor.encode([drive[5]]) + np.array([2.4, 2.0, 0.0, 0.0])
    new = advise_mapping(graph, steps, poses, matcher.match(strange, nodes))
    assert new.novelty == pytest.approx(0.95)
    assert "new" in new.hint.text


def test_where_nothing_is_left_to_mend_the_rim_is_next() -> None:
    poses = np.array([[0.2 * k, 0.5, np.pi * (k % 2)] for k in range(20)])
    advice = coached(chain(poses), poses)
    assert "beyond what you have seen, right where you are" in str(advice.hint)
    assert advice.target is not None
    assert advice.target.x_m in (0.0, pytest.approx(3.8))


def test_before_anything_was_driven_the_hint_is_to_drive() -> None:
    advice = advise_mapping(TopologicalGraph(), [], np.empty((0, 3)))
    assert advice.target is None
    assert (advice.strongly_connected_components, advice.missing_closures, advice.one_sided_places, advice.novelty) == (
        (),
        (),
        (),
        None,
    )


def test_nodes_from_an_older_drive_are_another_visit() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    graph = TopologicalGraph(NodeAdded(Node(k, PoseRow(0.1, 0.0, 0.0)), Cause.LOAD) for k in (0, 900))
    assert len(find_missing_loop_closures(graph, [900, 950], poses)) == 1
    assert len(find_missing_loop_closures(graph, [], np.empty((0, 3)))) == 1


def test_many_rounds_and_a_long_way_are_counted_right() -> None:
    poses = ring(laps=15)
    graph = chain(poses)
    advice = coached(graph, poses)
    assert strongly_connected_components(graph) == (tuple(range(480)),)
    assert advice.missing_closures
    assert all(abs(loop.first - loop.second) % 32 in (0, 1, 31) for loop in advice.missing_closures)
    long = np.array([[0.5 * k, 0.0, 0.0] for k in range(2000)])
    assert coached(chain(long), long).missing_closures == ()
