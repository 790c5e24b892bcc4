"""What the structure of a map tells: its floors, edges that lead elsewhere, and where a gap is narrowest."""

from dataclasses import replace

import numpy as np

from ltvn_core.analysis.floors import number_floors
from ltvn_core.analysis.map_findings import contradicted_edges, map_gap
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.graph.deltas import Cause, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.node_layout import lay_out
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.core.graph.small_maps import edge_added, node_added
from tests.repository import DEMO_MAP


def floors(graph: TopologicalGraph) -> list[set[int]]:
    nodes = np.array(list(graph.nodes), np.int64)
    edges = np.searchsorted(nodes, np.array(list(graph.edges), np.int64).reshape(-1, 2))
    numbers = number_floors(nodes, edges, np.array([bool(edge.action) for edge in graph.edges.values()], bool))
    return [set(nodes[numbers == floor].tolist()) for floor in range(numbers.max(initial=-1) + 1)]


def house(*edges: tuple[int, int] | tuple[int, int, str], nodes: int) -> TopologicalGraph:
    joined = (edge_added(source, target, action="".join(action)) for source, target, *action in edges)
    return TopologicalGraph([*map(node_added, range(nodes)), *joined])


def test_actions_alone_separate_floors() -> None:
    graph = house((0, 1), (2, 3), (4, 3), (1, 2, "Take the lift"), (2, 1, "Take the lift"), nodes=5)
    assert floors(graph) == [{2, 3, 4}, {0, 1}]


def test_a_map_without_actions_is_one_floor_even_in_pieces() -> None:
    assert floors(house((0, 1), (2, 3), nodes=5)) == [set(range(5))]
    assert floors(TopologicalGraph()) == []


def test_a_door_with_a_way_around_separates_nothing_and_loose_pieces_count_to_the_largest_floor() -> None:
    assert floors(house((0, 1), (0, 1 + 1), (1, 2, "Open the door"), nodes=3)) == [{0, 1, 2}]
    graph = house((0, 1), (1, 2), (2, 3, "Take the lift"), (4, 5), nodes=6)
    assert floors(graph) == [{0, 1, 2, 4, 5}, {3}]


def test_floors_are_laid_out_far_apart_although_an_action_joins_them() -> None:
    poses = lay_out(house((0, 1), (2, 3), (1, 2, "Take the lift"), nodes=4)).poses
    assert abs(poses[0, 0] - poses[2, 0]) > 1000


def demo_graph() -> TopologicalGraph:
    return load_map(DEMO_MAP).graph


def test_only_an_edge_that_leads_elsewhere_than_odometry_is_contradicted() -> None:
    graph = demo_graph()
    assert contradicted_edges(graph) == ()
    edge = next(iter(graph.edges.values()))
    graph.apply(EdgePruned(edge.source, edge.target, Cause.LOAD))
    graph.apply(EdgeAdded(replace(edge, waypoint=PoseRow(6.0, 0.0, 0.0)), Cause.LOAD))
    (found,) = contradicted_edges(graph)
    ((pair, odometry_m),) = found.pairs
    assert pair == (edge.source, edge.target)
    assert "6.00 m long" in found.finding.text
    assert odometry_m < 4.0


def test_a_map_in_two_parts_has_a_gap_that_is_narrowest_between_them() -> None:
    graph = demo_graph()
    goal = next(iter(graph.nodes))
    start = next(node for node in graph.nodes if (node, goal) in graph.edges)
    assert map_gap(graph, start, goal) is None
    for edge in [edge for edge in graph.edges if goal in edge]:
        graph.apply(EdgePruned(*edge, Cause.LOAD))
    gap = map_gap(graph, start, goal)
    assert gap is not None
    assert f"1 other nodes to node {goal}" in gap.finding.text
    assert all(edge[1] == goal for edge, _ in gap.pairs)
    assert [apart for _, apart in gap.pairs] == sorted(apart for _, apart in gap.pairs)
