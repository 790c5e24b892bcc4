"""Edges along which the robot turns on the spot, between nodes of one place that see nothing in common (ours).

The network joins images that share a view, so a map knows a way back only where the drive turned slowly, and a robot
that faces the wrong way drives to such a place first. Odometry knows that two nodes lie side by side, whichever way
they face, and between two places hardly farther apart than a robot is wide there is no wall. Of these edges only those
come in that make a way a good deal shorter: a greedy spanner (Althöfer, Das, Dobkin, Joseph and Soares, On Sparse
Spanners of Weighted Graphs, 1993). Owns their choice.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rustworkx
from scipy.spatial import KDTree

from ltvn_core.config import Method
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import bidirectional_edges
from ltvn_core.graph.planner import edge_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId

_PLACE_M = 0.45
"""Nodes nearer to each other than this are at one place: a small robot on both sides of the thinnest wall is farther
apart."""
_STRETCH = 1.2
"""Without the edge the way must cost so many times as much; 1.5 bounds SPL lower (`docs/results.md`)."""
_MOST_DRIVEN_M = 10.0
"""By a longer way odometry does not know well enough where two nodes lie."""


def turning_edges(graph: TopologicalGraph, gate: OdometryGate, method: Method) -> Iterator[EdgeAdded]:
    """Yield edges, each with the one back: the shortest first, as long as there is no way nearly as short."""
    ways = _Ways.of(graph, method)
    for turn in sorted(_turns(graph, gate, method), key=lambda turn: turn.matches.distances[0]):
        there, back = bidirectional_edges(turn.source, turn.matches, method.believing, Cause.BUILD, by_odometry=True)
        if ways.is_shortened_by(there.edge):
            ways.add(there.edge)
            ways.add(back.edge)
            yield from (there, back)


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    source: NodeId
    matches: Matches
    """The one node to turn to."""


def _turns(graph: TopologicalGraph, gate: OdometryGate, method: Method) -> Iterator[_Turn]:
    """Yield each pair of nodes at one place once, as far as odometry knows, that no edge joins."""
    nodes = tuple(graph.nodes)
    places = np.array([node.odometry[:2] for node in graph.nodes.values()])
    # No image speaks for it, so it is believed no more than the least edge that images speak for.
    belief = method.building.connect_reachability
    for k, beside in enumerate(KDTree(places).query_ball_point(places, _PLACE_M, return_sorted=True)):
        others = [nodes[j] for j in beside if j > k and (nodes[k], nodes[j]) not in graph.edges]
        if not others:
            continue
        waypoints, driven_m = gate.seen_from(nodes[k], others)
        known = (driven_m <= _MOST_DRIVEN_M) & (np.hypot(waypoints[:, 0], waypoints[:, 1]) <= _PLACE_M)
        for j in np.flatnonzero(known):
            yield _Turn(nodes[k], Matches.of_one(others[j], belief, waypoints[j]))


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """What the ways of a map cost, as edges come in."""

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
        """Tell whether the way between its ends costs much more without the edge."""
        source, target = self.rows[edge.source], self.rows[edge.target]
        lengths = rustworkx.dijkstra_shortest_path_lengths(self.costs, source, float, goal=target)
        return target not in lengths or lengths[target] > _STRETCH * self._cost(edge)

    def _cost(self, edge: Edge) -> float:
        return edge_cost(edge.belief, self.method.planning)
