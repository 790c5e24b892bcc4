"""Edge betweenness: the share of all cheapest paths that run over an edge, which tells how much the edge matters.

Owns the counting. What an edge costs is the planner's.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ltvn_core.graph.connectivity import cost_matrix
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.planner import EdgeWeight
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_SOURCES = 32
"""Nodes from which paths are counted; more takes longer."""


def edge_betweenness(
    graph: TopologicalGraph, *, weight: EdgeWeight | None = None, sources: int = _SOURCES
) -> Mapping[EdgeKey, float]:
    """Return for each edge the share in [0, 1] of cheapest paths that run over it; edges without any are left out.

    Paths start at `sources` nodes, evenly spread over the graph's age, and end everywhere; the paper's cost mu stands
    in for a missing `weight`. Takes O(sources * (edges + nodes) log nodes): about two seconds for 50,000 edges.
    """
    nodes, costs = cost_matrix(graph, weight or _length)
    if len(nodes) < 2:
        return {}
    starts = np.unique(np.linspace(0, len(nodes) - 1, min(sources, len(nodes))).astype(np.intp))
    counts: dict[tuple[int, int], int] = {}
    paths = 0
    for start in starts:
        lengths, before = dijkstra(costs, indices=int(start), return_predecessors=True)
        below = _paths_below(lengths, before)
        paths += int(below[start]) - 1
        for target in np.flatnonzero(before >= 0).tolist():
            key = int(before[target]), target
            counts[key] = counts.get(key, 0) + int(below[target])
    return {(nodes[i], nodes[j]): count / paths for (i, j), count in counts.items()}


def _length(belief: Belief) -> float:
    return belief.mu


def _paths_below(lengths: NDArray[np.float64], before: NDArray[np.intp]) -> NDArray[np.intp]:
    """Count for each node (N,) the paths that end at it or run on from it, in one tree of cheapest paths."""
    below = np.isfinite(lengths).astype(np.intp)
    for node in np.argsort(-np.where(np.isfinite(lengths), lengths, -1.0), kind="stable").tolist():
        if before[node] >= 0:
            below[before[node]] += below[node]
    return below
