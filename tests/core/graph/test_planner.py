"""The planner finds what brute force finds, on a mirror that never goes stale."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.config import PAPER, ROBUST
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, EdgePruned, GraphDelta, NodeDropped
from ltvn_core.graph.planner import NO_PATH, Planner, edge_cost
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from tests.core.graph.small_maps import edge_added, node_added


@st.composite
def small_maps(draw: st.DrawFn) -> TopologicalGraph:
    pairs = draw(st.sets(st.tuples(st.integers(0, 5), st.integers(0, 5)).filter(lambda pair: pair[0] != pair[1])))
    edges = [edge_added(a, b, draw(st.floats(0.01, 3)), draw(st.floats(0.05, 0.95))) for a, b in sorted(pairs)]
    return TopologicalGraph([*map(node_added, range(6)), *edges])


def brute_force(graph: TopologicalGraph, start: int, goal: int, penalties: dict[EdgeKey, float]) -> float:
    """Return the least cost over all simple paths."""
    inner = [each for each in graph.nodes if each not in (start, goal)]
    best = 0.0 if start == goal else math.inf
    for count in range(len(inner) + 1):
        for middle in itertools.permutations(inner, count):
            steps = list(itertools.pairwise((start, *middle, goal)))
            if start != goal and all(step in graph.edges for step in steps):
                costs = [
                    edge_cost(graph.edges[step].belief, ROBUST.planning) + penalties.get(step, 0) for step in steps
                ]
                best = min(best, sum(costs))
    return best


@settings(max_examples=60)
@given(small_maps(), st.integers(0, 5), st.integers(0, 5), st.randoms(use_true_random=False))
def test_the_plan_is_the_cheapest_of_all_paths(graph: TopologicalGraph, start: int, goal: int, random: object) -> None:
    penalties = {key: 2.0 for k, key in enumerate(graph.edges) if k % 3 == 0}
    path = Planner(graph, ROBUST.planning).plan(start, goal, penalties)
    assert path.cost == pytest.approx(brute_force(graph, start, goal, penalties))
    assert bool(path.nodes) == math.isfinite(path.cost)
    assert all(step in graph.edges for step in itertools.pairwise(path.nodes))


def diamond() -> TopologicalGraph:
    """0 -> 1 -> 3 is short, 0 -> 2 -> 3 is long."""
    edges = edge_added(0, 1), edge_added(1, 3), edge_added(0, 2, 2.0), edge_added(2, 3, 2.0)
    return TopologicalGraph([*map(node_added, range(4)), *edges])


def test_the_literal_method_counts_length_alone_and_the_robust_one_doubts() -> None:
    graph = diamond()
    graph.apply(BeliefUpdated(0, 1, Belief(0.05, 1.0, 0.02), 0, 0, Cause.ATTEMPT))
    assert Planner(graph, PAPER.planning).plan(0, 3).nodes == (0, 1, 3)
    assert Planner(graph, ROBUST.planning).plan(0, 3).nodes == (0, 2, 3)


def test_a_penalty_holds_for_one_plan_only() -> None:
    planner = Planner(diamond(), ROBUST.planning)
    assert planner.plan(0, 3, {(0, 1): 5.0}).nodes == (0, 2, 3)
    assert planner.plan(0, 3).nodes == (0, 1, 3)


def test_an_infinite_penalty_closes_an_edge() -> None:
    planner = Planner(diamond(), ROBUST.planning)
    assert planner.plan(0, 3, {(0, 1): math.inf, (2, 3): math.inf}) == NO_PATH


def test_penalties_on_edges_that_are_gone_are_ignored() -> None:
    assert Planner(diamond(), ROBUST.planning).plan(0, 3, {(7, 8): 1.0}).nodes == (0, 1, 3)


def test_hard_negatives_have_no_path() -> None:
    assert Planner(diamond(), ROBUST.planning).plan(0, 99) == NO_PATH
    assert Planner(TopologicalGraph(), ROBUST.planning).plan(0, 0) == NO_PATH


@pytest.mark.parametrize("follows", [True, False], ids=["told of every delta", "told of nothing"])
def test_the_mirror_never_goes_stale(follows: bool) -> None:
    graph, rng = TopologicalGraph(map(node_added, range(12))), np.random.default_rng(3)
    planner = Planner(graph, ROBUST.planning)
    for _ in range(120):
        a, b = (int(one) for one in rng.choice(12, 2, replace=False))
        delta = _change(graph, a, b, rng)
        if delta is None:
            continue
        graph.apply(delta)
        if follows:
            planner.mirror_delta(delta)
        start, goal = (int(one) for one in rng.choice(12, 2))
        fresh = Planner(graph, ROBUST.planning).plan(start, goal)
        assert planner.plan(start, goal).cost == pytest.approx(fresh.cost)


def _change(graph: TopologicalGraph, a: int, b: int, rng: np.random.Generator) -> GraphDelta | None:
    if a not in graph.nodes:
        return node_added(a)
    if b not in graph.nodes:
        return None
    if (a, b) not in graph.edges:
        return edge_added(a, b, float(rng.random()))
    match rng.integers(4):
        case 0:
            return EdgePruned(a, b, Cause.HAND)
        case 1:
            return NodeDropped(a, Cause.HAND)
        case _:
            return BeliefUpdated(a, b, Belief(float(rng.random()), float(rng.random()), 0.02), 0, 0, Cause.ATTEMPT)
