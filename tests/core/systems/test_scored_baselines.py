"""SoRB joins what an ensemble calls near; HTM weighs edges by the share of a score among all."""

import itertools

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import LocalisationPrior
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems import sorb
from ltvn_core.systems.htm import EDGES_PER_NODE, cheapest_edges, htm_system, inverse_share, shares
from ltvn_core.systems.sorb import MAX_STEPS, choose_goal_if_nearer, sorb_system
from ltvn_core.systems.temporal_distance import reachability_of_steps
from ltvn_core.types import Observation
from tests.core.flat_world import TemporalPredictor, observation_at, one_room

LINE = [observation_at(np.array([0.6 + 0.1 * k, 1.0, 0.0]), k) for k in range(30)]


def mapped(system: NavigationSystem, images: list[Observation], goals: tuple[int, ...] = ()) -> TopologicalGraph:
    predictor = TemporalPredictor(one_room())
    rng = np.random.default_rng(0)
    return TopologicalGraph(system.build(images, KeyframeStore(predictor), predictor, rng=rng, goals=goals))


def test_sorb_joins_what_is_within_maxdist_and_paths_are_as_long_as_they_take() -> None:
    system = sorb_system(ROBUST)
    graph = mapped(system, LINE)
    assert set(graph.edges) == {(a, b) for a in range(30) for b in range(30) if a != b and abs(a - b) < MAX_STEPS}
    assert system.edge_weight(graph.edges[3, 5].belief) == pytest.approx(2.0)
    assert Planner(graph, ROBUST.planning, weight=system.edge_weight).plan(0, 29).cost == pytest.approx(29)


def test_sorbs_nodes_are_a_buffer_of_images_drawn_from_all_and_the_goals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sorb, "BUFFER_SIZE", 10)
    graph = mapped(sorb_system(ROBUST), LINE, goals=(7, 21))
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
    system, predictor = sorb_system(ROBUST), TemporalPredictor(one_room())
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
    system, predictor = htm_system(ROBUST), TemporalPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(system.build(LINE, keyframes, predictor, rng=np.random.default_rng(0)))
    path = Planner(graph, ROBUST.planning, weight=system.edge_weight).plan(0, 29).nodes
    assert path[-1] == 29
    assert all(after > before for before, after in itertools.pairwise(path))
    assert len(path) > 5  # The whole way in one edge would cost more.
    matcher = Matcher(predictor, keyframes, system.method.matching)
    far = predictor.encode([observation_at(np.array([1.4, 3.0, 0.0]), 99)])
    assert system.localise(far, graph, LocalisationPrior(), matcher).node == 8
