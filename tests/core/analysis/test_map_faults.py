"""What odometry alone tells of a map: edges that lead elsewhere, and where a gap is narrowest."""

from dataclasses import replace

from ltvn_core.analysis.map_faults import contradicted_edges, map_gap
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.graph.deltas import Cause, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.repository import DEMO_MAP


def demo_graph() -> TopologicalGraph:
    return load_map(DEMO_MAP).graph


def test_only_an_edge_that_leads_elsewhere_than_odometry_is_contradicted() -> None:
    graph = demo_graph()
    assert contradicted_edges(graph) == ()
    edge = next(iter(graph.edges.values()))
    graph.apply(EdgePruned(edge.source, edge.target, Cause.LOAD))
    graph.apply(EdgeAdded(replace(edge, waypoint=PoseRow(6.0, 0.0, 0.0)), Cause.LOAD))
    (found,) = contradicted_edges(graph)
    assert found.edge == (edge.source, edge.target)
    assert found.length_m == 6.0
    assert found.gap_m > found.odometry_m


def test_a_map_in_two_parts_has_a_gap_that_is_narrowest_between_them() -> None:
    graph = demo_graph()
    goal = next(iter(graph.nodes))
    start = next(node for node in graph.nodes if (node, goal) in graph.edges)
    assert map_gap(graph, start, goal) is None
    for edge in [edge for edge in graph.edges if goal in edge]:
        graph.apply(EdgePruned(*edge, Cause.LOAD))
    gap = map_gap(graph, start, goal)
    assert gap is not None
    assert gap.leading == 1
    assert gap.reached <= len(graph.nodes) - 1
    assert all(pair.edge[1] == goal for pair in gap.nearest)
    assert [pair.distance for pair in gap.nearest] == sorted(pair.distance for pair in gap.nearest)
