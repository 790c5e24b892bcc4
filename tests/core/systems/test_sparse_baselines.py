"""Rivals that keep few images or weigh scores by rules of their own."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import Belief, BeliefUpdated, EdgePruned
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, LOCAL, LocalisationPrior
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.planner import Planner, reachable_nodes
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems import temporal_distance
from ltvn_core.systems.brm import posterior
from ltvn_core.systems.meng import ADJACENT_P, AnchorMap, RememberedReach, sparsify
from ltvn_core.systems.placenav import BayesFilter
from ltvn_core.systems.system_table import BRM, HTM, MENG, PLACENAV, SGM, SORB
from ltvn_core.systems.temporal_closeness import EDGES_PER_NODE, cheapest_edges, inverse_share, shares
from ltvn_core.systems.temporal_distance import (
    EDGE_STEPS,
    MAX_STEPS,
    MERGE_STEPS,
    NEAREST_COUNT,
    choose_goal_if_nearer,
    merge_consistent,
    nearest_edges,
    reachability_of_steps,
)
from ltvn_core.types import Observation, Pose
from tests.core.flat_world import FlatPredictor, TemporalPredictor, observation_at, one_room, tour

ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 3.2), (0.7, 0.7), (2.0, 0.7)]
IMAGES = list(tour(ROUND, spins=False))


class Corridor:
    """Images at places along a line in metres; one is reachable from another within `sight_m`."""

    def __init__(self, places: Sequence[float] | NDArray[np.float64], sight_m: float) -> None:
        self.places, self.sight_m = np.array(places), sight_m
        self.asked: list[tuple[int, int]] = []

    def __call__(self, sources: Sequence[int], targets: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        self.asked += zip(sources, targets, strict=True)
        ahead = self.places[list(targets)] - self.places[list(sources)]
        waypoints = np.stack([ahead, 0 * ahead, 0 * ahead], axis=-1)
        return np.where(np.abs(ahead) <= self.sight_m, 0.99, 0.1), waypoints


def pose(seen: Observation) -> Pose:
    assert seen.exact_pose is not None
    return seen.exact_pose


def mapped(
    system: NavigationSystem, images: list[Observation], predictor: FlatPredictor | None = None
) -> tuple[TopologicalGraph, Matcher]:
    predictor = predictor or FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(system.build(images, keyframes, predictor, rng=np.random.default_rng(0)))
    return graph, Matcher(predictor, keyframes, system.method.matching)


def test_an_anchor_is_the_last_image_that_can_still_be_reached_from_the_one_before() -> None:
    places = np.arange(0.0, 3.01, 0.25)
    assert sparsify(Corridor(places, sight_m=1.0), 0, 12) == [0, 4, 8, 12]
    assert sparsify(Corridor(places, sight_m=0.1), 0, 3) == [0, 1, 2, 3]
    assert sparsify(Corridor(places, sight_m=1.0), 0, 12, goals=[5]) == [0, 4, 5, 9, 12]


def test_a_second_drive_along_the_same_way_uses_the_anchors_of_the_first() -> None:
    there = np.arange(0.0, 5.01, 0.25)
    back = there[::-1][1:]
    anchors = AnchorMap(Corridor([*there, *back], 1.0), (), np.random.default_rng(0), both_directions=True)
    anchors.add(0, 20)
    first = anchors.nodes
    anchors.add(20, 40)
    assert len(anchors.nodes) < 2 * len(first)
    assert {(b, a) for a, b in anchors.edges} == set(anchors.edges)
    once = AnchorMap(Corridor(there, 1.0), (), np.random.default_rng(0), both_directions=False)
    once.add(0, 20)
    assert set(once.edges) == {(0, 4), (4, 8), (8, 12), (12, 16), (16, 20)}


def test_what_was_answered_once_is_not_asked_again_and_the_map_is_the_same() -> None:
    there = np.arange(0.0, 5.01, 0.25)
    plain, remembered = (Corridor([*there, *there[::-1][1:]], 1.0) for _ in range(2))
    maps = [
        AnchorMap(reach, (), np.random.default_rng(0), both_directions=True)
        for reach in (plain, RememberedReach(remembered, both_directions=True))
    ]
    for anchors in maps:
        anchors.add(0, 20)
        anchors.add(20, 40)
    assert maps[0].nodes == maps[1].nodes
    edges, again = maps[0].edges, maps[1].edges
    assert list(edges) == list(again)
    for ends, edge in edges.items():
        assert (edge.p, *edge.waypoint) == pytest.approx((again[ends].p, *again[ends].waypoint))
    assert len(remembered.asked) == len({frozenset(pair) for pair in remembered.asked}) < len(plain.asked) / 2


def test_places_seen_in_two_drives_are_joined_only_where_whole_windows_are_near() -> None:
    # The second drive crosses the first at a right angle: one anchor is near, the anchors around it are not.
    class Cross(Corridor):
        def __call__(self, sources, targets):  # noqa: ANN001, ANN204
            reachability, waypoints = super().__call__(sources, targets)
            apart = (np.array(sources) >= 21) != (np.array(targets) >= 21)
            meet = {(10, 31), (31, 10)}
            near = [pair in meet for pair in zip(sources, targets, strict=True)]
            return np.where(apart, np.where(near, 0.99, 0.1), reachability), waypoints

    line = np.arange(0.0, 5.01, 0.25)
    anchors = AnchorMap(Cross([*line, *line], 0.25), (), np.random.default_rng(0), both_directions=True)
    anchors.add(0, 20)
    anchors.add(21, 41)
    assert not {(10, 31), (31, 10)} & set(anchors.edges)


def test_meng_weighs_ways_by_their_probability_and_finds_its_place_along_the_path_first() -> None:
    system = MENG.factory(ROBUST)
    graph, matcher = mapped(system, IMAGES)
    assert 4 < len(graph.nodes) < len(IMAGES) / 2
    assert system.edge_weight(Belief(ADJACENT_P, 1.0, 0.1)) == pytest.approx(1e-4, rel=0.01)
    here = FlatPredictor(one_room()).encode([IMAGES[0]])
    assert system.localise(here, graph, LocalisationPrior(), matcher).scope == GLOBAL
    found = system.localise(here, graph, LocalisationPrior(tuple(graph.nodes)[:3]), matcher)
    assert (found.node, found.scope) == (IMAGES[0].step, LOCAL)


def test_an_image_merges_where_all_neighbours_see_it_where_they_see_the_node() -> None:
    line = np.abs(np.subtract.outer(np.arange(12.0), np.arange(12.0)))
    nodes = merge_consistent(line)
    assert nodes[:2] == [0, 1]  # The first node has no edges to compare yet, so the second image is no double of it.
    assert 2 <= len(nodes) < 12
    assert merge_consistent(line, kept=set(range(12))) == list(range(12))
    places = np.array([*range(11), 30.0])
    look_alike = np.abs(np.subtract.outer(places, places))
    look_alike[11, 0] = look_alike[0, 11] = 0.5 * MERGE_STEPS  # Resembles the first, but the second is far from it.
    assert 11 in merge_consistent(look_alike)


def test_of_each_node_the_five_shortest_edges_stay() -> None:
    line = np.abs(np.subtract.outer(np.arange(20.0), np.arange(20.0)))
    edges = nearest_edges(line)
    assert all(sum(source == node for source, _ in edges) == NEAREST_COUNT for node in range(20))
    assert max(line[edge] for edge in edges) < EDGE_STEPS
    assert nearest_edges(line * 10) == []


def test_sgms_map_is_sparse_and_leads_everywhere() -> None:
    system = SGM.factory(ROBUST)
    graph, matcher = mapped(system, IMAGES, TemporalPredictor(one_room()))
    assert len(graph.nodes) < len(IMAGES) / 2
    start = next(iter(graph.nodes))
    assert len(reachable_nodes(graph, start)) > 0.9 * len(graph.nodes)
    here = TemporalPredictor(one_room()).encode([IMAGES[0]])
    assert system.localise(here, graph, LocalisationPrior(), matcher).node == IMAGES[0].step


def test_sgm_deletes_an_edge_at_its_first_failure() -> None:
    graph, _ = mapped(SGM.factory(ROBUST), IMAGES)
    source, target = next(iter(graph.edges))
    maintenance = SGM.factory(ROBUST).maintenance
    failed = AttemptEvidence(source=source, target=target, distance=1.0, succeeded=False)
    (delta,) = maintenance.after_attempt(graph, failed)
    assert isinstance(delta, EdgePruned)
    graph.apply(delta)
    assert maintenance.after_attempt(graph, failed) == ()
    assert maintenance.after_attempt(graph, AttemptEvidence(target, source, 1.0, succeeded=True)) == ()


def test_brm_doubts_an_edge_at_once_and_believes_again_after_a_success() -> None:
    assert posterior(0.9, succeeded=False) < 0.5 < posterior(0.9, succeeded=True)
    once = posterior(0.9, succeeded=False)
    assert posterior(once, succeeded=True) > 0.99
    system = BRM.factory(ROBUST)
    graph, _ = mapped(system, IMAGES)
    source, target = next(iter(graph.edges))
    failed = AttemptEvidence(source=source, target=target, distance=1.0, succeeded=False)
    (delta,) = system.maintenance.after_attempt(graph, failed)
    assert isinstance(delta, BeliefUpdated)
    assert delta.belief.p < graph.edges[source, target].belief.p
    assert (delta.attempts, delta.successes) == (1, 0)
    assert system.edge_weight(delta.belief) > system.edge_weight(graph.edges[source, target].belief)


def test_a_belief_over_places_is_not_carried_off_by_one_image_that_resembles_another_place() -> None:
    graph, matcher = mapped(PLACENAV.factory(ROBUST), IMAGES)
    image_of = {seen.step: seen for seen in IMAGES}
    here = min(graph.nodes)
    away = max(graph.nodes, key=lambda node: np.hypot(*(pose(image_of[node]) - pose(image_of[here]))[:2]))
    under_way, follow = LocalisationPrior(tuple(graph.nodes)), BayesFilter()
    encode = FlatPredictor(one_room()).encode
    place = follow(encode([image_of[here]]), graph, LocalisationPrior(), matcher)
    assert (place.node, place.scope) == (here, GLOBAL)
    for _ in range(3):
        place = follow(encode([image_of[here]]), graph, under_way, matcher)
    assert (place.node, place.scope) == (here, LOCAL)
    assert follow(encode([image_of[away]]), graph, under_way, matcher).node != away
    assert follow(encode([image_of[away]]), graph, LocalisationPrior(), matcher).node == away


LINE = [observation_at(np.array([0.6 + 0.1 * k, 1.0, 0.0]), k) for k in range(30)]


def graph_of(system: NavigationSystem, images: list[Observation], goals: tuple[int, ...] = ()) -> TopologicalGraph:
    predictor = TemporalPredictor(one_room())
    rng = np.random.default_rng(0)
    return TopologicalGraph(system.build(images, KeyframeStore(predictor), predictor, rng=rng, goals=goals))


def test_sorb_joins_what_is_within_maxdist_and_paths_are_as_long_as_they_take() -> None:
    system = SORB.factory(ROBUST)
    graph = graph_of(system, LINE)
    assert set(graph.edges) == {(a, b) for a in range(30) for b in range(30) if a != b and abs(a - b) < MAX_STEPS}
    assert system.edge_weight(graph.edges[3, 5].belief) == pytest.approx(2.0)
    assert Planner(graph, ROBUST.planning, weight=system.edge_weight).plan(0, 29).cost == pytest.approx(29)


def test_sorbs_nodes_are_a_buffer_of_images_drawn_from_all_and_the_goals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(temporal_distance, "BUFFER_SIZE", 10)
    graph = graph_of(SORB.factory(ROBUST), LINE, goals=(7, 21))
    assert {7, 21} <= set(graph.nodes)
    assert 10 <= len(graph.nodes) <= 12


def test_sorb_drives_to_the_goal_itself_where_that_is_near_and_no_farther_than_the_first_node() -> None:
    def chosen(first: float, goal: float) -> int:
        steps = {1: first, 2: 3.0, 9: goal}
        return choose_goal_if_nearer([0, 1, 2, 9], lambda node: reachability_of_steps(steps[node]))

    assert chosen(first=3.0, goal=2.0) == 3
    assert chosen(first=2.0, goal=3.0) == 1
    assert chosen(first=9.0, goal=MAX_STEPS + 1) == 1


def test_sorb_is_at_no_node_that_is_farther_than_maxdist() -> None:
    system, predictor = SORB.factory(ROBUST), TemporalPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(system.build(LINE, keyframes, predictor, rng=np.random.default_rng(0)))
    matcher = Matcher(predictor, keyframes, system.method.matching)
    for aside, node in ((0.3, 8), (0.6, None)):
        here = predictor.encode([observation_at(np.array([1.4, 1.0 + aside, 0.0]), 99)])
        assert system.localise(here, graph, LocalisationPrior(), matcher).node == node


def test_a_share_is_the_softmax_of_the_scores_and_its_inverse_the_sum_of_their_differences() -> None:
    scores = np.array([[5.0, 2.0, -1.0], [2.0, 5.0, 0.5], [-1.0, 0.5, 5.0]])
    found = shares(1 / (1 + np.exp(-scores)))
    assert found.sum(axis=1) == pytest.approx(np.ones(3))
    by_hand = np.exp(scores[0] - scores[0, 1]).sum()
    assert inverse_share(Belief(float(found[0, 1]), 1.0, 0.1)) == pytest.approx(by_hand)


def test_each_node_keeps_its_fifty_cheapest_edges() -> None:
    share = shares(np.random.default_rng(0).uniform(0.01, 0.99, (80, 80)))
    edges = cheapest_edges(share)
    assert len(edges) == len(set(edges)) == 80 * EDGES_PER_NODE
    left_out = share[0, [k for k in range(1, 80) if (0, k) not in edges]]
    assert left_out.max() <= min(share[edge] for edge in edges if edge[0] == 0)
    assert len(cheapest_edges(share[:3, :3])) == 6


def test_htms_path_goes_where_scores_are_high_and_it_is_always_somewhere() -> None:
    system, predictor = HTM.factory(ROBUST), TemporalPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(system.build(LINE, keyframes, predictor, rng=np.random.default_rng(0)))
    path = Planner(graph, ROBUST.planning, weight=system.edge_weight).plan(0, 29).nodes
    assert path[-1] == 29
    assert all(after > before for before, after in itertools.pairwise(path))
    assert len(path) > 5  # The whole way in one edge would cost more.
    matcher = Matcher(predictor, keyframes, system.method.matching)
    far = predictor.encode([observation_at(np.array([1.4, 3.0, 0.0]), 99)])
    assert system.localise(far, graph, LocalisationPrior(), matcher).node == 8
