"""Two maps are held against each other: what is only in one, what changed, and what matters most."""

import numpy as np
import pytest

from ltvn_core.analysis.map_comparison import MatchedBy, compare_maps, edge_betweenness, map_metrics
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph


def chain(count: int, *more: EdgeKey, shift_m: float = 0.0, first: int = 0) -> TopologicalGraph:
    """Return nodes in a row, a metre apart, joined both ways."""
    nodes = range(first, first + count)
    graph = TopologicalGraph(
        d.NodeAdded(d.Node(k, d.PoseRow(k - first + shift_m, 0.0, 0.0)), d.Cause.BUILD) for k in nodes
    )
    for i in nodes[:-1]:
        for key in ((i, i + 1), (i + 1, i)):
            graph.apply(added(*key))
    for key in more:
        graph.apply(added(*key))
    return graph


def added(source: int, target: int, p: float = 0.9) -> d.EdgeAdded:
    return d.EdgeAdded(d.Edge(source, target, d.PoseRow(1.0, 0.0, 0.0), d.Belief(p, 1.0, 0.01)), d.Cause.BUILD)


def test_a_map_does_not_differ_from_itself() -> None:
    difference = compare_maps(chain(5), chain(5))
    assert (difference.differing, difference.nodes_only_a, difference.edges_only_b) == ((), (), ())
    assert (len(difference.nodes), len(difference.edges)) == (5, 8)


def test_what_maintenance_did_is_the_difference_before_and_after() -> None:
    before, after = chain(6), chain(6)
    after.apply(d.EdgePruned(2, 3, d.Cause.ATTEMPT))
    after.apply(d.NodeDropped(5, d.Cause.HAND))
    after.apply(d.BeliefUpdated(0, 1, d.Belief(0.5, 1.0, 0.01), 1, 0, d.Cause.ATTEMPT))
    after.apply(added(0, 2))
    difference = compare_maps(before, after)
    assert difference.matched_by is MatchedBy.ID
    assert difference.nodes_only_a == (5,)
    assert set(difference.edges_only_a) == {(2, 3), (4, 5), (5, 4)}
    assert difference.edges_only_b == ((0, 2),)
    changed = [each for each in difference.differing if each.a is not None and each.b is not None]
    assert [each.change_of_p for each in changed] == [pytest.approx(-0.4)]


def test_a_node_that_was_given_a_name_is_still_the_same() -> None:
    named = chain(3)
    named.apply(d.NodeNamed(1, "sofa", False, d.Cause.HAND))
    difference = compare_maps(chain(3), named)
    assert (difference.nodes_only_a, difference.edges_only_a, difference.edges_only_b) == ((), (), ())


def test_the_edge_that_most_paths_need_comes_first() -> None:
    before, after = chain(9), chain(9)
    for key in ((0, 1), (4, 5)):
        after.apply(d.BeliefUpdated(*key, d.Belief(0.4, 1.0, 0.01), 1, 0, d.Cause.ATTEMPT))
    first, second = compare_maps(before, after).differing
    assert first.a is not None
    assert (first.a.source, first.a.target) == (4, 5)
    assert first.importance > second.importance > 0


def test_maps_of_two_drives_are_matched_by_place() -> None:
    a, b = chain(4), chain(5, shift_m=0.2, first=100)
    difference = compare_maps(a, b)
    assert difference.matched_by is MatchedBy.POSE
    assert difference.nodes == {0: 100, 1: 101, 2: 102, 3: 103}
    assert difference.nodes_only_b == (104,)
    assert set(difference.edges_only_b) == {(103, 104), (104, 103)}


def test_given_poses_count_more_than_odometry() -> None:
    a, b = chain(3), chain(3, shift_m=50.0, first=100)
    assert compare_maps(a, b).nodes == {}
    poses = {100 + k: np.array([float(k), 0.1, 0.0]) for k in range(3)}
    assert len(compare_maps(a, b, poses_b=poses).nodes) == 3


def test_empty_maps_compare() -> None:
    difference = compare_maps(TopologicalGraph(), chain(2))
    assert (difference.nodes, difference.nodes_only_b, len(difference.differing)) == ({}, (0, 1), 2)
    assert map_metrics(TopologicalGraph()).mean_p is None


def test_every_path_of_a_chain_runs_over_its_middle() -> None:
    share = edge_betweenness(chain(4))
    assert share[1, 2] == pytest.approx(4 / 12)
    assert share[0, 1] == pytest.approx(3 / 12)


def test_a_large_map_is_compared_whole() -> None:
    rng = np.random.default_rng(0)
    big = chain(2000)
    for i, j in rng.integers(0, 2000, (6000, 2)).tolist():
        if i != j and (i, j) not in big.edges:
            big.apply(added(i, j, float(rng.random())))
    other = big.copy()
    gone = list(other.edges)[::50]
    for key in gone:
        other.apply(d.EdgePruned(*key, d.Cause.ATTEMPT))
    assert len(compare_maps(big, other).differing) == len(gone)
