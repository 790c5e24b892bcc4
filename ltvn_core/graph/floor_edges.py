"""Edges over floor that was seen free, between nodes that see nothing in common or that the drive never joined (ours).

The network joins only images that share a view, and the drive did not take every path. Without these edges, a robot
that faces the wrong way first drives to where the drive turned, and a robot that crosses a hall follows the course of
the drive. The corrected odometry gives the relative pose of two nodes, and the depth images show whether the floor
between them is free. An edge is added only if it makes a path much shorter: a greedy spanner (Althöfer, Das, Dobkin,
Joseph and Soares, On Sparse Spanners of Weighted Graphs, 1993). Owns the choice of these edges; `graph.free_floor`
decides whether floor is free.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rustworkx
from scipy.spatial import KDTree

from ltvn_core.config import Method
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded
from ltvn_core.graph.free_floor import WELL_KNOWN_M, FreeFloor
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import bidirectional_edges
from ltvn_core.graph.planner import edge_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId

_PLACE_M = 0.45
"""Distance in metres below which two nodes are one place: robots on both sides of the thinnest wall are farther
apart."""
_REACH_M = 5.0
"""Length of the longest edge, in metres."""
_LONG_M = 2.5
"""Length of an edge above which a robot may lose its place on the way, in metres."""
_REACH_RAD = 1.5
"""Largest turn at the end of an edge, in radians; after a larger turn the robot's image shows nothing of the target."""
_STRETCH = 1.2
"""Least ratio between the cost of the path without an edge and the cost of the edge; 1.5 lowers SPL
(`docs/results.md`)."""
_LONG_STRETCH = 1.6
"""The same for a long edge: only a shortcut across a hall is worth driving so far without localising."""
_MOST_DRIVEN_M = 60.0
"""Greatest length of the path along the drive over which odometry still gives the relative pose of two nodes, in
metres."""
_DOUBTED = 0.5
"""p of an edge that odometry does not know well; it is driven only where the detour is long."""


def floor_edges(graph: TopologicalGraph, gate: OdometryGate, floor: FreeFloor, method: Method) -> Iterator[EdgeAdded]:
    """Yield edges in both directions, the shortest first, wherever no existing path is nearly as short."""
    ways = _Ways.of(graph, method)
    for pair in sorted(_pairs(graph, gate, method), key=lambda pair: pair.matches.distances[0]):
        there, back = bidirectional_edges(pair.source, pair.matches, method.believing, Cause.BUILD, by_odometry=True)
        if ways.is_shortened_by(there.edge) and (pair.is_one_place or floor.joins(pair.source, pair.matches)):
            ways.add(there.edge)
            ways.add(back.edge)
            yield from (there, back)


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    source: NodeId
    matches: Matches
    """The other node, as a single match."""

    @property
    def is_one_place(self) -> bool:
        """Whether the two nodes are so close that nothing fits between them."""
        return bool(np.hypot(*self.matches.waypoints[0, :2]) <= _PLACE_M)


def _pairs(graph: TopologicalGraph, gate: OdometryGate, method: Method) -> Iterator[_Pair]:
    """Yield each pair of near nodes once, if odometry gives their relative pose and no edge joins them."""
    nodes = tuple(graph.nodes)
    places = np.array([node.odometry[:2] for node in graph.nodes.values()])
    # No image supports the edge, so it gets the lowest p that an edge supported by images can have.
    most = method.building.connect_reachability
    for k, beside in enumerate(KDTree(places).query_ball_point(places, _REACH_M, return_sorted=True)):
        others = [nodes[j] for j in beside if j > k and (nodes[k], nodes[j]) not in graph.edges]
        if not others:
            continue
        waypoints, driven_m = gate.seen_from(nodes[k], others)
        away_m = np.hypot(waypoints[:, 0], waypoints[:, 1])
        in_reach = (away_m <= _REACH_M) & (np.abs(waypoints[:, 2]) <= _REACH_RAD)
        known = (driven_m <= _MOST_DRIVEN_M) & (in_reach | (away_m <= _PLACE_M))
        for j in np.flatnonzero(known):
            belief = most if driven_m[j] <= WELL_KNOWN_M else _DOUBTED
            yield _Pair(nodes[k], Matches.of_one(others[j], belief, waypoints[j]))


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """Costs of the paths in a map, updated as edges are added."""

    costs: "rustworkx.PyDiGraph[NodeId, float]"
    rows: dict[NodeId, int]
    method: Method

    @classmethod
    def of(cls, graph: TopologicalGraph, method: Method) -> "_Ways":
        costs = rustworkx.PyDiGraph[NodeId, float]()
        rows = dict(zip(graph.nodes, costs.add_nodes_from(list(graph.nodes)), strict=True))
        ways = cls(costs, rows, method)
        for edge in graph.edges.values():
            ways.add(edge)
        return ways

    def add(self, edge: Edge) -> None:
        self.costs.add_edge(self.rows[edge.source], self.rows[edge.target], self._cost(edge))

    def is_shortened_by(self, edge: Edge) -> bool:
        """Tell whether the path between an edge's ends costs much more without the edge."""
        source = self.rows[edge.source]
        target = self.rows[edge.target]
        lengths = rustworkx.dijkstra_shortest_path_lengths(self.costs, source, float, goal=target)
        stretch = _STRETCH if np.hypot(*edge.waypoint[:2]) <= _LONG_M else _LONG_STRETCH
        return target not in lengths or lengths[target] > stretch * self._cost(edge)

    def _cost(self, edge: Edge) -> float:
        return edge_cost(edge.belief, self.method.planning)
