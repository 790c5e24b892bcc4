"""Algorithm 1: sparse, connected, the same for the same seed, and clear about what it cannot build from."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.geometry import compose, distance, relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import Cause, FramesReleased, GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import OnlineBuilder
from ltvn_core.graph.planner import reachable_nodes
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour, two_rooms

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 3.2), (0.7, 0.7)]
IMAGES = list(tour(ROUND))


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


@cache
def known(method: Method) -> tuple[TopologicalGraph, KeyframeStore, FlatPredictor]:
    """Return the map of a round through one room; nobody may change it."""
    return built(IMAGES, method)


@PRESETS
def test_the_map_is_sparse_and_in_one_piece(method: Method) -> None:
    graph, _, _ = known(method)
    start = next(iter(graph.nodes))
    assert 10 < len(graph.nodes) < len(IMAGES) / 2
    assert reachable_nodes(graph, start) == set(graph.nodes)


@PRESETS
def test_every_edge_passes_the_operator_and_has_its_way_back(method: Method) -> None:
    images = IMAGES
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
    images = {seen.step: seen for seen in IMAGES}
    graph, _, _ = known(method)
    for (source, target), edge in graph.edges.items():
        truth = relative(images[source].odometry, images[target].odometry)
        assert np.allclose(edge.waypoint, truth, atol=1e-6)


def test_no_two_nodes_could_have_merged_after_both_were_there() -> None:
    graph, keyframes, _ = known(PAPER)
    nodes = list(graph.nodes)
    poses = np.array([keyframes.observation(node).odometry for node in nodes])
    for k in range(1, len(nodes)):
        gaps = distance(relative(poses[k], poses[:k]))
        assert gaps.min() >= PAPER.building.merge_distance - 1e-9


@PRESETS
def test_the_same_seed_builds_the_same_map(method: Method) -> None:
    assert built(IMAGES, method)[0] == known(method)[0] != built(IMAGES, method, seed=5)[0]


def test_the_reserve_keeps_merged_images_only_in_the_robust_method() -> None:
    robust, keyframes, _ = known(ROBUST)
    assert len(robust.nodes) + len(robust.reserve) == len(IMAGES) == len(keyframes)
    paper, keyframes, _ = known(PAPER)
    assert len(paper.reserve) == 0
    assert len(keyframes) == len(paper.nodes)


def test_goal_frames_always_become_nodes() -> None:
    images = IMAGES
    goals = [images[k].step for k in (5, 6, 7, 60)]
    predictor = FlatPredictor(one_room())
    deltas = build(images, KeyframeStore(predictor), predictor, ROBUST, np.random.default_rng(1), goals=goals)
    assert set(goals) <= set(TopologicalGraph(deltas).nodes)


def test_a_false_match_that_its_neighbours_in_time_deny_makes_no_edge() -> None:
    images = IMAGES
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


@pytest.mark.parametrize("seed", range(3))
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


def driven(
    images: Iterable[Observation], method: Method = ROBUST, sight_m: float = 2.0
) -> tuple[TopologicalGraph, KeyframeStore, list[GraphDelta]]:
    graph, predictor, history = TopologicalGraph(), FlatPredictor(one_room(), sight_m=sight_m), []
    keyframes = KeyframeStore(predictor)
    online = OnlineBuilder(graph, keyframes, predictor, method)
    for seen in images:
        for delta in online.offer(seen):
            graph.apply(delta)
            history.append(delta)
    return graph, keyframes, history


def test_the_map_grows_in_one_piece_and_is_the_fold_of_what_was_told() -> None:
    graph, keyframes, history = driven(IMAGES)
    assert 10 < len(graph.nodes) < len(IMAGES) / 2
    assert reachable_nodes(graph, IMAGES[0].step) == set(graph.nodes)
    assert TopologicalGraph(history) == graph
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)


def test_the_first_image_is_a_node_and_the_same_image_again_changes_nothing() -> None:
    seen = observation_at(np.array([1.0, 1.0, 0.0]), 5)
    graph, _, history = driven([seen, seen])
    assert list(graph.nodes) == [5]
    assert len(history) == 1


def test_a_near_sighted_predictor_joins_images_by_way_of_merged_ones() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    graph, keyframes, history = driven(images, sight_m=0.4)
    assert np.ptp([node.odometry.x_m for node in graph.nodes.values()]) > 2.8
    assert reachable_nodes(graph, images[0].step) == set(graph.nodes)
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)
    assert TopologicalGraph(history) == graph
    without = replace(ROBUST, building=replace(ROBUST.building, bridges=False))
    assert len(driven(images, without, sight_m=0.4)[0].nodes) < 3


def test_the_reserve_is_bounded_and_its_oldest_images_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ltvn_core.graph.ltvn.MOST_RESERVED", 25)
    graph, keyframes, _ = driven(tour(ROUND))
    assert len(graph.reserve) == 25
    assert len(keyframes) == len(graph.nodes) + 25


def test_the_literal_method_forgets_merged_images() -> None:
    graph, keyframes, _ = driven(tour(ROUND), method=PAPER)
    assert set(keyframes.frames) == set(graph.nodes) | set(graph.reserve)
    assert not graph.reserve


def test_an_image_without_neighbours_waits_until_one_comes() -> None:
    start, far = observation_at(np.array([0.7, 0.7, 0.0]), 0), observation_at(np.array([3.5, 0.7, 0.0]), 1)
    between = [observation_at(np.array([x, 0.7, 0.0]), step) for step, x in enumerate((1.4, 2.1, 2.8), 2)]
    graph, _, _ = driven([start, far])
    assert list(graph.reserve) == [1]
    graph, _, _ = driven([start, far, *between])
    assert set(graph.nodes) == {0, 1, 2, 3, 4}
    assert not graph.reserve


def test_an_image_that_navigation_took_out_of_the_reserve_is_left_alone() -> None:
    graph, predictor = TopologicalGraph(), FlatPredictor(one_room())
    online = OnlineBuilder(graph, KeyframeStore(predictor), predictor, ROBUST)
    places = ((0, 0.7), (1, 3.5), (2, 1.4), (3, 2.1), (4, 2.8))
    for step, x in places:
        for delta in online.offer(observation_at(np.array([x, 0.7, 0.0]), step)):
            graph.apply(delta)
        if step == 1:
            graph.apply(FramesReleased((1,), Cause.EXPAND))
    assert set(graph.nodes) == {0, 2, 3, 4}
