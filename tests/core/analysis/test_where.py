"""Where the robot thinks it is, how sure it was, and which places the network confuses or a picture looks like."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from ltvn_core.analysis.image_similarity import most_similar_nodes
from ltvn_core.analysis.localisation_confidence import features_of, find_perceptual_aliases, localisation_heat_map
from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, EdgePruned, Node, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import NO_PRIOR, localise
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import StampedEvent
from ltvn_core.types import NodeId, Observation
from tests.core.flat_world import FlatPredictor, FlatWorld, box, observation_at, one_room
from tests.repository import DEMO_DRIVE

RNG = np.random.default_rng(0)
SAME = np.array([0.1, 0.0, 0.0])
LITERAL = replace(ROBUST, matching=replace(ROBUST.matching, temporal_support=False))


@dataclass(frozen=True)
class Corridor:
    """A long corridor of places 0.5 m apart, each joined to the next, whose predictor may confuse some."""

    graph: TopologicalGraph
    matcher: Matcher
    predictor: FlatPredictor
    drive: tuple[Observation, ...]


def corridor(count: int = 24, *, lies: Sequence[tuple[NodeId, NodeId]] = (), method: Method = LITERAL) -> Corridor:
    drive = tuple(observation_at(np.array([0.5 + 0.5 * k, 1.0, 0.0]), k) for k in range(count))
    world = FlatWorld(np.array(box(0.5 * count + 1, 2.0)))
    predictor = FlatPredictor(world, lies={pair: SAME for pair in lies})
    keyframes = KeyframeStore(predictor)
    keyframes.add(drive)
    graph = TopologicalGraph(
        NodeAdded(Node(k, PoseRow(*map(float, drive[k].odometry))), Cause.BUILD) for k in range(count)
    )
    for k in range(1, count):
        join(graph, k - 1, k)
    return Corridor(graph, Matcher(predictor, keyframes, method.matching), predictor, drive)


def join(graph: TopologicalGraph, a: NodeId, b: NodeId) -> None:
    for source, target in ((a, b), (b, a)):
        graph.apply(EdgeAdded(Edge(source, target, PoseRow(0.5, 0, 0), Belief(0.9, 0.5, 0.02)), Cause.BUILD))


def test_the_heat_map_is_coldest_where_the_robot_is() -> None:
    place = corridor()
    image = place.predictor.encode([observation_at(np.array([4.05, 1.0, 0.0]), 99)])
    found = localisation_heat_map(image, tuple(place.graph.nodes), place.matcher, ROBUST.localising)
    assert found.nodes == tuple(range(24))
    assert found.distances.shape == found.scores.shape == (24,)
    assert found.best(2) == (7, 8)
    fix = localise(image, place.graph, NO_PRIOR, place.matcher, config=ROBUST.localising)
    assert (fix.node, fix.runner_up) == found.best(2)
    assert found.margin == pytest.approx(fix.margin)
    assert found.near[7]
    assert not found.near[20]


def test_an_image_at_hand_is_not_encoded_again() -> None:
    place = corridor()
    before = place.predictor.encoded
    assert np.array_equal(features_of(place.drive[3], place.matcher, place.predictor)[0, :3], [2.0, 1.0, 0.0])
    assert place.predictor.encoded == before
    features_of(observation_at(np.zeros(3), 99), place.matcher, place.predictor)
    assert place.predictor.encoded == before + 1


def test_an_empty_map_is_neither_warm_nor_cold() -> None:
    place = corridor()
    found = localisation_heat_map(place.predictor.encode([place.drive[0]]), (), place.matcher, ROBUST.localising)
    assert found.best(3) == ()
    assert math.isinf(found.margin)


@cache
def demo() -> list[StampedEvent]:
    return Recording.open(DEMO_DRIVE).events


@pytest.mark.parametrize("candidates", [None, 22])
def test_a_perceptual_alias_pair_is_found_and_nothing_else(candidates: int | None) -> None:
    place = corridor(lies=[(3, 20), (20, 3)])
    (pair,) = find_perceptual_aliases(place.graph, place.matcher, LITERAL, candidates=candidates)
    assert (pair.first, pair.second) == (3, 20)
    assert pair.contradicted_by_odometry
    assert not pair.has_edge
    assert pair.odometry_m == pytest.approx(8.5)
    assert pair.path_length == pytest.approx(8.5)
    assert "3 and 20 look 0.10 apart (r 0.95), yet they are 8.5 m apart by odometry" in pair.sentence


def test_false_edges_come_first() -> None:
    place = corridor(lies=[(1, 23), (3, 20)])
    join(place.graph, 3, 20)
    found = find_perceptual_aliases(place.graph, place.matcher, LITERAL, candidates=None)
    assert [(pair.first, pair.second, pair.has_edge) for pair in found] == [(3, 20, True), (1, 23, False)]
    assert found[0].path_length == 8.5  # Without the false edge itself.
    assert "an edge joins them" in found[0].sentence


def test_a_false_edge_is_asked_about_whatever_the_images_look_like() -> None:
    place = corridor(lies=[(3, 20)])
    join(place.graph, 3, 20)
    (pair,) = find_perceptual_aliases(place.graph, place.matcher, LITERAL, candidates=1)
    assert (pair.first, pair.second) == (3, 20)


def test_neighbours_in_time_acquit_a_pair_where_the_method_asks_them() -> None:
    place = corridor(lies=[(3, 20), (20, 3)], method=ROBUST)
    assert find_perceptual_aliases(place.graph, place.matcher, ROBUST, candidates=None) == ()


def test_the_literal_method_is_judged_by_odometry_too() -> None:
    place = corridor(lies=[(3, 20)], method=PAPER)
    (pair,) = find_perceptual_aliases(place.graph, place.matcher, PAPER, candidates=None)
    assert pair.contradicted_by_odometry


def test_a_place_that_the_map_holds_for_far_is_told_even_if_odometry_agrees() -> None:
    place = corridor()
    for edge in ((11, 12), (12, 11)):
        place.graph.apply(EdgePruned(*edge, Cause.HAND))
    found = find_perceptual_aliases(place.graph, place.matcher, LITERAL, candidates=None)
    assert {(pair.first, pair.second) for pair in found} == {(10, 12), (11, 12), (11, 13)}
    assert all(math.isinf(pair.path_length) and not pair.contradicted_by_odometry for pair in found)


def test_an_empty_map_has_no_pairs() -> None:
    assert find_perceptual_aliases(TopologicalGraph(), corridor(5).matcher, LITERAL) == ()


def test_a_map_whose_images_are_missing_says_so() -> None:
    place = corridor(5)
    place.matcher.keyframes.drop([2])
    with pytest.raises(MapError, match="image of frame 2"):
        find_perceptual_aliases(place.graph, place.matcher, LITERAL)


def noise_images(count: int) -> KeyframeStore:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    for k in range(count):
        patches = RNG.integers(0, 256, (9, 12, 3), dtype=np.uint8)
        rgb = patches.repeat(8, axis=0).repeat(8, axis=1)
        keyframes.add([replace(observation_at(np.zeros(3), k), rgb=rgb)])
    return keyframes


def test_the_same_image_comes_first_even_noisy_and_darker() -> None:
    keyframes = noise_images(20)
    seen = keyframes.observation(13).rgb.astype(np.float64) * 0.6 + RNG.normal(0, 10, (72, 96, 3))
    ranked = most_similar_nodes(seen.clip(0, 255).astype(np.uint8), keyframes, range(20), 3)
    assert ranked[0][0] == 13
    assert ranked[0][1] > 0.9 > ranked[1][1]
    assert len(ranked) == 3


def test_a_blank_image_looks_like_nothing_in_particular() -> None:
    ranked = most_similar_nodes(np.full((72, 96, 3), 90, np.uint8), noise_images(4), range(4), 2)
    assert [likeness for _, likeness in ranked] == [0.0, 0.0]


def test_without_nodes_nothing_looks_alike() -> None:
    assert most_similar_nodes(np.zeros((72, 96, 3), np.uint8), noise_images(1), [], 3) == ()
