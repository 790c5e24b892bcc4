"""Algorithm 1: sparse, connected, the same for the same seed, and clear about what it cannot build from."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.geometry import compose, distance, relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import reachable_nodes
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour, two_rooms

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 3.2), (0.7, 0.7)]


def built(
    images: Sequence[Observation], method: Method, seed: int = 0, predictor: FlatPredictor | None = None
) -> tuple[TopologicalGraph, KeyframeStore, FlatPredictor]:
    predictor = predictor or FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    return (
        TopologicalGraph(build(images, keyframes, predictor, method, np.random.default_rng(seed))),
        keyframes,
        predictor,
    )


@PRESETS
def test_the_map_is_sparse_and_in_one_piece(method: Method) -> None:
    images = list(tour(ROUND))
    graph, _, _ = built(images, method)
    start = next(iter(graph.nodes))
    assert 10 < len(graph.nodes) < len(images) / 2
    assert reachable_nodes(graph, start) == set(graph.nodes)


@PRESETS
def test_every_edge_passes_the_operator_and_has_its_way_back(method: Method) -> None:
    images = list(tour(ROUND))
    graph, _, predictor = built(images, replace(method, building=replace(method.building, floor_edges=False)))
    for (source, target), edge in graph.edges.items():
        assert distance(np.array(edge.waypoint)) < method.building.connect_distance
        assert edge.belief.p <= method.believing.p_cap
        back = graph.edges[target, source]
        assert np.allclose(compose(np.array(edge.waypoint), np.array(back.waypoint)), 0, atol=1e-9)
        assert edge.belief.mu == pytest.approx(back.belief.mu)
    assert predictor.encoded == len(images)


@PRESETS
def test_an_edge_carries_the_waypoint_of_its_target_in_the_frame_of_its_source(method: Method) -> None:
    images = {seen.step: seen for seen in tour(ROUND)}
    graph, _, _ = built(list(images.values()), method)
    for (source, target), edge in graph.edges.items():
        truth = relative(images[source].odometry, images[target].odometry)
        assert np.allclose(edge.waypoint, truth, atol=1e-6)


def test_no_two_nodes_could_have_merged_after_both_were_there() -> None:
    graph, keyframes, _ = built(list(tour(ROUND)), PAPER)
    nodes = list(graph.nodes)
    poses = np.array([keyframes.observation(node).odometry for node in nodes])
    for k in range(1, len(nodes)):
        gaps = distance(relative(poses[k], poses[:k]))
        assert gaps.min() >= PAPER.building.merge_distance - 1e-9


@PRESETS
def test_the_same_seed_builds_the_same_map(method: Method) -> None:
    images = list(tour(ROUND))
    assert built(images, method, seed=4)[0] == built(images, method, seed=4)[0]
    assert built(images, method, seed=4)[0] != built(images, method, seed=5)[0]


def test_the_reserve_keeps_merged_images_only_in_the_robust_method() -> None:
    images = list(tour(ROUND))
    robust, keyframes, _ = built(images, ROBUST)
    assert len(robust.nodes) + len(robust.reserve) == len(images) == len(keyframes)
    paper, keyframes, _ = built(images, PAPER)
    assert len(paper.reserve) == 0
    assert len(keyframes) == len(paper.nodes)


def test_goal_frames_always_become_nodes() -> None:
    images = list(tour(ROUND))
    goals = [images[k].step for k in (5, 6, 7, 60)]
    predictor = FlatPredictor(one_room())
    deltas = build(images, KeyframeStore(predictor), predictor, ROBUST, np.random.default_rng(1), goals=goals)
    assert set(goals) <= set(TopologicalGraph(deltas).nodes)


def test_building_asks_far_less_than_all_pairs() -> None:
    images = list(tour([*ROUND, *ROUND[1:], *ROUND[1:]]))
    _, _, predictor = built(images, PAPER)
    assert predictor.compared < len(images) ** 2 / 3


def test_a_false_match_that_its_neighbours_in_time_deny_makes_no_edge() -> None:
    images = list(tour(ROUND))
    near, far = images[3], images[len(images) // 2]
    lies = {(near.step, far.step): np.array([0.6, 0.0, 0.0])}
    goals = [near.step, far.step]  # So that both are nodes.
    for method, expected in ((ROBUST, False), (PAPER, True)):
        predictor = FlatPredictor(one_room(), lies=lies)
        deltas = build(images, KeyframeStore(predictor), predictor, method, np.random.default_rng(0), goals=goals)
        assert ((near.step, far.step) in TopologicalGraph(deltas).edges) is expected


def test_a_start_that_touches_nothing_is_tried_again_elsewhere() -> None:
    lonely = observation_at(np.array([2.5, 2.0, 0.0]), 9000, odometry=np.array([50.0, 0.0, 0.0]))

    class Blind(FlatPredictor):
        def predict(self, sources: np.ndarray, targets: np.ndarray):  # noqa: ANN202
            answer = super().predict(sources, targets)
            strange = (np.broadcast_to(sources, targets.shape)[:, 3] == 9000) | (targets[:, 3] == 9000)
            answer.reachability[strange] = 0.01
            return answer

    images = [*tour(ROUND), lonely]
    predictor = Blind(one_room())
    deltas = build(images, KeyframeStore(predictor), predictor, ROBUST, StartsWithLast(len(images)))
    assert len(TopologicalGraph(deltas).nodes) > 10
    once = replace(ROBUST, building=replace(ROBUST.building, largest_piece=False))
    deltas = build(images, KeyframeStore(predictor), predictor, once, StartsWithLast(len(images)))
    assert list(TopologicalGraph(deltas).nodes) == [9000]


class StartsWithLast(np.random.Generator):
    """Permutes nothing except that the last image comes first."""

    def __init__(self, count: int) -> None:
        super().__init__(np.random.PCG64(0))
        self._count = count

    def permutation(self, x: int, axis: int = 0) -> np.ndarray:  # type: ignore[override]
        order = super().permutation(x, axis)
        return np.roll(np.arange(x), 1) if x == self._count else order


def test_two_unconnected_places_leave_one_of_them_in_reserve() -> None:
    images = [*tour([(0.7, 0.7), (2.3, 0.7)]), *tour([(5.3, 3.3), (4.0, 3.3)], first_step=5000)]
    predictor = FlatPredictor(two_rooms(), sight_m=1.0)
    graph, _, _ = built(images, ROBUST, predictor=predictor)
    sides = {frame >= 5000 for frame in graph.nodes}
    assert len(sides) == 1
    assert graph.reserve


@pytest.mark.parametrize("seed", range(6))
def test_the_larger_of_two_unconnected_places_is_kept_whatever_the_seed(seed: int) -> None:
    images = [*tour([(0.7, 0.7), (2.3, 0.7)]), *tour([(5.3, 3.3), (4.0, 3.3)], first_step=5000)]
    predictor = FlatPredictor(two_rooms(), sight_m=1.0)
    deltas = build(images, KeyframeStore(predictor), predictor, ROBUST, np.random.default_rng(seed))
    assert min(TopologicalGraph(deltas).nodes) >= 5000  # 66 of the 117 images.


def test_an_empty_trajectory_is_refused() -> None:
    with pytest.raises(MapError, match="empty; drive and record"):
        built([], ROBUST)


@PRESETS
def test_one_image_makes_a_map_of_one_node(method: Method) -> None:
    graph, _, _ = built([observation_at(np.array([1.0, 1.0, 0.0]), 3)], method)
    assert list(graph.nodes) == [3]
    assert not graph.edges


@PRESETS
def test_images_that_all_look_alike_make_a_map_of_one_node(method: Method) -> None:
    graph, _, _ = built([observation_at(np.array([1.0, 1.0, 0.0]), step) for step in range(30)], method)
    assert len(graph.nodes) == 1


def test_repeated_frame_numbers_and_foreign_goals_are_refused() -> None:
    twice = [observation_at(np.zeros(3), 1), observation_at(np.zeros(3), 1)]
    with pytest.raises(MapError, match="repeat"):
        built(twice, ROBUST)
    predictor = FlatPredictor(one_room())
    with pytest.raises(MapError, match=r"\[77\] are not in the trajectory"):
        build(twice[:1], KeyframeStore(predictor), predictor, ROBUST, np.random.default_rng(0), goals=[77])


@pytest.mark.parametrize(
    "method",
    [ROBUST, PAPER, replace(ROBUST, building=replace(ROBUST.building, close_loops=False, floor_edges=False))],
    ids=["robust", "paper", "without_loops_and_floor"],
)
def test_progress_counts_up_to_all_images_through_all_stages(method: Method) -> None:
    images, seen = list(tour(ROUND)), [(0, 0)]
    predictor = FlatPredictor(one_room())
    build(
        images,
        KeyframeStore(predictor),
        predictor,
        method,
        np.random.default_rng(0),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == sorted(seen)
    assert seen[-1] == (len(images), len(images))
    assert np.diff([done for done, _ in seen]).max() < len(images) / 4
