"""Connectivity of a map: strongly connected components, and the costs of all edges as a matrix.

Owns these two views of a graph. The cheapest path between two nodes is `graph.planner`.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import rustworkx
from scipy.sparse import csr_array

from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.planner import EdgeWeight
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_LEAST_COST = 1e-9
"""Cost for edges that cost nothing, because a sparse matrix drops zeros."""


class CostMatrix(NamedTuple):
    """The edges of a graph as a sparse matrix of costs."""

    nodes: tuple[NodeId, ...]
    """The N nodes, in the order of the rows."""
    costs: csr_array
    """(N, N) cost of each edge."""


def cost_matrix(graph: TopologicalGraph, weight: EdgeWeight) -> CostMatrix:
    """Return the costs of a graph's edges as a sparse matrix; linear in edges."""
    nodes = tuple(graph.nodes)
    row = {node: k for k, node in enumerate(nodes)}
    ends = np.array([(row[source], row[target]) for source, target in graph.edges], np.intp).reshape(-1, 2)
    costs = np.array([max(weight(edge.belief), _LEAST_COST) for edge in graph.edges.values()], np.float64)
    return CostMatrix(nodes, csr_array((costs, (ends[:, 0], ends[:, 1])), (len(nodes), len(nodes))))


def mirrored(
    graph: TopologicalGraph, edges: Iterable[EdgeKey]
) -> "tuple[rustworkx.PyDiGraph[NodeId, None], dict[NodeId, int]]":
    """Return all nodes of a map and some of its edges as a graph of rustworkx, and the index of each node in it."""
    mirror: rustworkx.PyDiGraph[NodeId, None] = rustworkx.PyDiGraph(multigraph=False)
    index = dict(zip(graph.nodes, mirror.add_nodes_from(list(graph.nodes)), strict=True))
    mirror.add_edges_from_no_data([(index[source], index[target]) for source, target in edges])
    return mirror, index


def strongly_connected_components(
    graph: TopologicalGraph, over: Callable[[Edge], bool] = lambda edge: True
) -> tuple[tuple[NodeId, ...], ...]:
    """Return the strongly connected components of a map, the largest first, the nodes of each in order.

    Within one, a path leads from every node to every other, over edges that `over` accepts. Linear in nodes and edges.
    """
    mirror, _ = mirrored(graph, (key for key, edge in graph.edges.items() if over(edge)))
    parts = [tuple(sorted(mirror[k] for k in part)) for part in rustworkx.strongly_connected_components(mirror)]
    return tuple(sorted(parts, key=lambda part: (-len(part), part)))


def count_strongly_connected_components(graph: TopologicalGraph) -> int:
    """Return the number of strongly connected components of a map; 1 is ideal."""
    return len(strongly_connected_components(graph))
