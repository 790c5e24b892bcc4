"""Edges over floor that was seen free, between nodes that see nothing in common or that the drive never joined (ours).

The network joins only images that share a view, and the drive did not take every path. Without these edges, a robot
that faces the wrong way first drives to where the drive turned, and a robot that crosses a hall follows the course of
the drive. The corrected odometry gives the relative pose of two nodes, and the depth images show whether the floor
between them is free. An edge is added only if it makes a path much shorter: a greedy spanner (Althöfer, Das, Dobkin,
Joseph and Soares, On Sparse Spanners of Weighted Graphs, 1993). Owns the choice of these edges; `graph.free_floor`
decides whether floor is free, `CourseErrors` whether odometry knows where both nodes are: it drifts with the distance
driven, and relates two passes wrongly where recognised images say another relative pose.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from ltvn_core.config import Method
from ltvn_core.geometry import distance, relative, wrap_angle
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded
from ltvn_core.graph.free_floor import LONGEST_M, WELL_KNOWN_M, FreeFloor
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import bidirectional_edges, initial_belief
from ltvn_core.graph.planner import cost_matrix, edge_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId

_USUAL_M, _USUAL_RAD = 0.033, 0.013
"""Usual standard deviation of corrected odometry after one metre, along each axis in m, and in rad; for drives that do
not show their own. It grows with the square root of the distance driven, as measured in `tune-hall-0` and
`tune-tables-0`."""
_LEAST_M, _LEAST_RAD = 0.015, 0.006
"""Least such errors: the images of a drive show no smaller ones."""
_COMPARED_M = 4.0
"""Least distance driven between recognised images that shows the drift, in metres."""
_LEAST_COMPARED = 12
"""Least number of pairs of recognised images that show the drift of a drive."""
_PLANE_MEDIAN, _MEDIAN = 1.177, 0.6745
"""Median distance of errors in the plane, and median size of errors along one axis, in standard deviations."""
_KNOWN_M, _KNOWN_RAD = 0.25, np.deg2rad(10.0)
"""Greatest standard deviation up to which a relative pose is known, in m and rad."""
_SAME_PASS_M = 5.0
"""Distance along the drive within which images belong to one pass, in metres."""
_CONTRADICTS_M, _CONTRADICTS_RAD = 0.5, np.deg2rad(20.0)
"""Median disagreement of recognised images with odometry above which they contradict it, in m and rad; a single
waypoint errs by up to 0.6 m."""


class CourseErrors:
    """Errors of the corrected odometry in one map."""

    def __init__(self, graph: TopologicalGraph, gate: OdometryGate) -> None:
        """Compare the edges between recognised images with odometry."""
        self._gate = gate
        edges = [edge for edge in graph.driven_edges.values() if not edge.by_odometry]
        by_source: dict[NodeId, list[int]] = {}
        for k, edge in enumerate(edges):
            by_source.setdefault(edge.source, []).append(k)
        gaps, path_m = np.zeros((len(edges), 3)), np.full(len(edges), np.inf)
        waypoints = np.array([edge.waypoint for edge in edges]).reshape(-1, 3)
        ends = np.array([gate.rows([edge.source, edge.target]) for edge in edges], np.intp).reshape(-1, 2)
        for source, own in by_source.items():
            driven, path_m[own] = gate.seen_from(source, ends[own, 1])
            gaps[own] = relative(waypoints[own], driven)
        known = np.isfinite(path_m)
        self._off_m = np.hypot(gaps[known, 0], gaps[known, 1])
        self._off_rad = np.abs(wrap_angle(gaps[known, 2]))
        self._passes = KDTree(gate.along_m[ends[known]])
        self._growth_m = _growth(self._off_m, path_m[known], _PLANE_MEDIAN, (_USUAL_M, _LEAST_M))
        self._growth_rad = _growth(self._off_rad, path_m[known], _MEDIAN, (_USUAL_RAD, _LEAST_RAD))

    def error_m(self, path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviations (M,) of positions, in metres, after odometry paths of some lengths (M,)."""
        return self._growth_m * np.sqrt(path_m)

    def know(self, path_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell (M,) whether relative poses are known after odometry paths of some lengths (M,) in metres."""
        return (self.error_m(path_m) <= _KNOWN_M) & (self._growth_rad * np.sqrt(path_m) <= _KNOWN_RAD)

    def contradict(self, source: NodeId, target: NodeId) -> bool:
        """Tell whether the images around two nodes, along the drive, say another relative pose than odometry."""
        if not self._passes.n:
            return False
        passes = self._gate.along_m[self._gate.rows([source, target])]
        # Within a pass of their own, the images between the two nodes say nothing about both.
        reach_m = min(_SAME_PASS_M, float(np.ptp(passes)) / 3)
        near = self._passes.query_ball_point(passes, reach_m, p=np.inf)
        if not near:
            return False
        off_m, off_rad = np.median(self._off_m[near]), np.median(self._off_rad[near])
        return bool(off_m > _CONTRADICTS_M or off_rad > _CONTRADICTS_RAD)


def _growth(off: NDArray[np.float64], path_m: NDArray[np.float64], median: float, limits: tuple[float, float]) -> float:
    """Return the standard deviation after one metre that disagreements (N,) after paths (N,) show, beyond those without
    a path; `limits` are the usual and the least one, and `median` is that of a unit deviation."""
    long = path_m >= _COMPARED_M
    if long.sum() < _LEAST_COMPARED or long.all():
        return limits[0]
    at_once = np.median(off[~long])
    return max(limits[1], float(np.median(np.maximum(off[long] - at_once, 0.0) / np.sqrt(path_m[long]))) / median)


_PLACE_M = 0.45
"""Distance in metres below which two nodes are one place: robots on both sides of the thinnest wall are farther
apart."""
_LONG_M = 2.5
"""Length of an edge above which a robot may lose its place on the way, in metres."""
_STRETCH = 1.2
"""Least ratio between the cost of the path without an edge and the cost of the edge; 1.5 lowers SPL
(`docs/results.md`)."""
_LONG_STRETCH = 1.6
"""The same for a long edge: only a shortcut across a hall is worth driving so far without localising."""
_DOUBTED = 0.5
"""p of an edge that odometry does not know well; it is driven only where the detour is long."""


def floor_edges(
    graph: TopologicalGraph,
    gate: OdometryGate,
    floor: FreeFloor,
    method: Method,
    progress: Callable[[float], None] = lambda share: None,
) -> Iterator[EdgeAdded]:
    """Yield edges in both directions, the shortest first, wherever no existing path is nearly as short.

    `progress` is called with the share of the pairs of nodes that are checked.
    """
    ways = _Ways(graph, method)
    errors = CourseErrors(graph, gate)
    pairs = sorted(_pairs(graph, gate, floor, errors, method), key=lambda pair: pair.matches.distances[0])
    for number, pair in enumerate(pairs):
        progress(number / len(pairs))
        if not ways.are_shortened_by(pair) or errors.contradict(pair.source, *pair.matches.nodes):
            continue
        is_one_place = np.hypot(*pair.matches.waypoints[0, :2]) <= _PLACE_M
        if is_one_place or floor.joins(pair.source, pair.matches, error_m=pair.error_m):
            both = bidirectional_edges(pair.source, pair.matches, method.believing, Cause.BUILD, by_odometry=True)
            for added in both:
                ways.add(added.edge)
                yield added


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Two nodes that an edge may join in both directions."""

    source: NodeId
    matches: Matches
    """The second node, as a single match of the first."""
    longest: float
    """Greatest cost of a path between the nodes that makes the edge superfluous."""
    error_m: float
    """Error of the second node's place, seen from the first."""


def _pairs(
    graph: TopologicalGraph, gate: OdometryGate, floor: FreeFloor, errors: CourseErrors, method: Method
) -> Iterator[_Pair]:
    """Yield each pair of near nodes once, if odometry gives their relative pose, the path between them is long, and the
    floor between them may be free."""
    nodes, costs = cost_matrix(graph, partial(edge_cost, config=method.planning))
    rows = gate.rows(nodes)
    places = np.array([node.odometry[:2] for node in graph.nodes.values()])
    # No image supports the edge, so it gets the lowest p that an edge supported by images can have.
    most = method.building.connect_reachability
    most_cost, doubt_cost = (
        edge_cost(initial_belief(p, 0.0, method.believing), method.planning) for p in (most, _DOUBTED)
    )
    for k, beside in enumerate(KDTree(places).query_ball_point(places, LONGEST_M, return_sorted=True)):
        others = np.array([j for j in beside if j > k and (nodes[k], nodes[j]) not in graph.edges], np.intp)
        waypoints, driven_m = gate.seen_from(nodes[k], rows[others])
        away_m = np.hypot(waypoints[:, 0], waypoints[:, 1])
        is_sure = driven_m <= WELL_KNOWN_M
        cost = distance(waypoints) + np.where(is_sure, most_cost, doubt_cost)
        longest = np.where(away_m <= _LONG_M, _STRETCH, _LONG_STRETCH) * cost
        # The edges that are added later only shorten these paths.
        paths = dijkstra(costs, indices=k, limit=longest.max(initial=0.0))[others]
        known = np.flatnonzero(errors.know(driven_m) & (away_m <= LONGEST_M) & (paths > longest))
        may_be_free = floor.may_join(rows[k], rows[others[known]], waypoints[known])
        for j in known[may_be_free | (away_m[known] <= _PLACE_M)]:
            matches = Matches.of_one(nodes[others[j]], most if is_sure[j] else _DOUBTED, waypoints[j])
            yield _Pair(nodes[k], matches, float(longest[j]), float(errors.error_m(driven_m[j])))


class _Ways:
    """Costs of the paths in a map, updated as edges are added."""

    def __init__(self, graph: TopologicalGraph, method: Method) -> None:
        self._config = method.planning
        self._onward: dict[NodeId, dict[NodeId, float]] = {node: {} for node in graph.nodes}
        """For each node the least cost of an edge to each of its successors."""
        for edge in graph.edges.values():
            self.add(edge)

    def add(self, edge: Edge) -> None:
        onward = self._onward[edge.source]
        onward[edge.target] = min(edge_cost(edge.belief, self._config), onward.get(edge.target, inf))

    def are_shortened_by(self, pair: _Pair) -> bool:
        """Tell whether the path between two nodes costs much more without their edge.

        Looks no farther than that, so the cost does not grow with the map.
        """
        (target,) = pair.matches.nodes
        costs = {pair.source: 0.0}
        ahead = [(0.0, pair.source)]
        while ahead:
            cost, node = heappop(ahead)
            if node == target:
                return False
            for other, more in self._onward[node].items():
                total = cost + more
                if total <= pair.longest and total < costs.get(other, inf):
                    costs[other] = total
                    heappush(ahead, (total, other))
        return True
