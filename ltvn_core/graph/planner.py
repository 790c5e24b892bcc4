"""The cheapest path through the map (Dijkstra), on a mirror of the graph that is kept between plans; connectivity.

Owns the mirror, the default cost of an edge, and strongly connected components. Does not decide what to do without a
path.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import rustworkx
from scipy.sparse import csr_array

from ltvn_core.config import PlanningConfig
from ltvn_core.graph import deltas as d
from ltvn_core.graph.place_belief import LIKELY
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_MIN_P = 1e-3
_BLIND_COST = 3.0
"""Cost of an edge that no image supports, for a robot that may be at several places."""

EdgeWeight: TypeAlias = Callable[[d.Belief], float]
"""Returns the cost of an edge from its belief; finite and not negative."""


class GraphPath(NamedTuple):
    """A path from the first to the last of its nodes."""

    nodes: tuple[NodeId, ...]
    """Empty when there is no path."""
    cost: float
    """Infinite when there is no path."""


NO_PATH = GraphPath((), math.inf)


def edge_cost(belief: d.Belief, config: PlanningConfig) -> float:
    """Return mu - weight * ln p, with the belief weight in `config`; mu alone if that is 0."""
    return belief.mu - config.belief_weight * math.log(max(belief.p, _MIN_P))


def with_blind_costs(
    graph: TopologicalGraph, penalties: Mapping[EdgeKey, float], place_p: float | None
) -> Mapping[EdgeKey, float]:
    """Return the extra costs of edges: those given and, while the robot may be at several places, one for each edge
    that no image supports.

    On such an edge a robot at another place than it believes notices nothing until it hits something. `place_p` is the
    probability of its likeliest place, None without a place belief.
    """
    if place_p is None or place_p > LIKELY:
        return penalties
    blind = {key: _BLIND_COST for key, edge in graph.edges.items() if edge.by_odometry}
    return blind | {key: cost + blind.get(key, 0.0) for key, cost in penalties.items()}


class Planner:
    """Plans on one graph; deltas handed to `mirror_delta` keep the mirror current, and a missed one causes a
    rebuild."""

    def __init__(self, graph: TopologicalGraph, config: PlanningConfig, *, weight: EdgeWeight | None = None) -> None:
        """Mirror `graph`; its edges cost `weight`, or `edge_cost` if no weight is given."""
        self._graph = graph
        self._weight = weight or partial(edge_cost, config=config)
        self._rebuild()

    def mirror_delta(self, delta: d.GraphDelta) -> None:
        """Mirror a delta that was just applied to the graph."""
        if self._version != self._graph.version - 1:
            return  # A delta was missed before; the next plan rebuilds.
        match delta:
            case d.BeliefUpdated():
                self._set_cost((delta.source, delta.target), self._weight(delta.belief))
            case d.EdgeAdded():
                ends = self._index[delta.edge.source], self._index[delta.edge.target]
                self._mirror.add_edge(*ends, self._weight(delta.edge.belief))
            case d.EdgePruned():
                self._mirror.remove_edge(self._index[delta.source], self._index[delta.target])
            case d.PresenceObserved() | d.EdgeActionSet():
                pass  # Presence is given with each plan, and the cost of an action is that of its edge's belief.
            case _:
                return  # Node indices change, or the change is rare, so the mirror is rebuilt.
        self._version = self._graph.version

    def plan(self, source: NodeId, goal: NodeId, penalties: Mapping[EdgeKey, float] | None = None) -> GraphPath:
        """Return the cheapest path; `penalties` are added to edges for this plan alone, infinite ones close them."""
        if self._version != self._graph.version:
            self._rebuild()
        if source not in self._index or goal not in self._index:
            return NO_PATH
        if source == goal:
            return GraphPath((source,), 0.0)
        penalties = {key: cost for key, cost in (penalties or {}).items() if key in self._graph.edges}
        for key, cost in penalties.items():
            self._set_cost(key, self._weight(self._graph.edges[key].belief) + cost)
        try:
            return self._dijkstra(self._index[source], self._index[goal])
        finally:
            for key in penalties:
                self._set_cost(key, self._weight(self._graph.edges[key].belief))

    def _dijkstra(self, start: int, end: int) -> GraphPath:
        found = rustworkx.dijkstra_shortest_paths(self._mirror, start, end, weight_fn=float)
        if end not in found:
            return NO_PATH
        steps = list(found[end])
        cost = sum(self._mirror.get_edge_data(a, b) for a, b in itertools.pairwise(steps))
        return GraphPath(tuple(self._mirror[k] for k in steps), cost) if math.isfinite(cost) else NO_PATH

    def _set_cost(self, key: EdgeKey, cost: float) -> None:
        self._mirror.update_edge(self._index[key[0]], self._index[key[1]], cost)

    def _rebuild(self) -> None:
        graph = self._graph
        self._mirror: rustworkx.PyDiGraph[NodeId, float] = rustworkx.PyDiGraph(multigraph=False)
        self._index = dict(zip(graph.nodes, self._mirror.add_nodes_from(list(graph.nodes)), strict=True))
        costs = ((*key, self._weight(edge.belief)) for key, edge in graph.edges.items())
        self._mirror.add_edges_from([(self._index[a], self._index[b], cost) for a, b, cost in costs])
        self._version = graph.version


_LEAST_COST = 1e-9
"""Cost for edges that cost nothing, because a sparse matrix drops zeros."""


def cost_matrix(graph: TopologicalGraph, weight: EdgeWeight) -> tuple[tuple[NodeId, ...], csr_array]:
    """Return the N nodes of a graph, and the costs of its edges as a sparse matrix (N, N) with a row for each node;
    linear in edges."""
    nodes = tuple(graph.nodes)
    row = {node: k for k, node in enumerate(nodes)}
    ends = np.array([(row[source], row[target]) for source, target in graph.edges], np.intp).reshape(-1, 2)
    costs = np.array([max(weight(edge.belief), _LEAST_COST) for edge in graph.edges.values()], np.float64)
    return nodes, csr_array((costs, (ends[:, 0], ends[:, 1])), (len(nodes), len(nodes)))


def mirrored(
    graph: TopologicalGraph, edges: Iterable[EdgeKey]
) -> "tuple[rustworkx.PyDiGraph[NodeId, None], dict[NodeId, int]]":
    """Return all nodes of a map and some of its edges as a graph of rustworkx, and the index of each node in it."""
    mirror: rustworkx.PyDiGraph[NodeId, None] = rustworkx.PyDiGraph(multigraph=False)
    index = dict(zip(graph.nodes, mirror.add_nodes_from(list(graph.nodes)), strict=True))
    mirror.add_edges_from_no_data([(index[source], index[target]) for source, target in edges])
    return mirror, index


def reachable_nodes(graph: TopologicalGraph, start: NodeId, *, backwards: bool = False) -> set[NodeId]:
    """Return all nodes that can be reached from `start`, or from which it can be reached, including itself."""
    mirror, index = mirrored(graph, graph.edges)
    found = (rustworkx.ancestors if backwards else rustworkx.descendants)(mirror, index[start])
    return {start, *(mirror[k] for k in found)}


def strongly_connected_components(
    graph: TopologicalGraph, over: Callable[[d.Edge], bool] = lambda edge: True
) -> tuple[tuple[NodeId, ...], ...]:
    """Return the strongly connected components of a map, the largest first, the nodes of each in order.

    Within one, a path leads from every node to every other, over edges that `over` accepts. Linear in nodes and edges.
    """
    mirror, _ = mirrored(graph, (key for key, edge in graph.edges.items() if over(edge)))
    parts = [tuple(sorted(mirror[k] for k in part)) for part in rustworkx.strongly_connected_components(mirror)]
    return tuple(sorted(parts, key=lambda part: (-len(part), part)))
