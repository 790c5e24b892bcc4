"""Faults of a map that may have made a query fail: edges that odometry contradicts, and a gap between two parts.

Uses neither ground truth nor images, only odometry. Odometry drifts, so these faults are hints and not proofs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rustworkx
from scipy.spatial import KDTree

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.connectivity import mirrored
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId, Pose

_LEAST_GAP_M = 1.5
"""Least disagreement between an edge and odometry that counts as a contradiction (ours)."""
_USUAL_QUANTILE = 0.95
"""Quantile of the disagreement over a map's edges that counts as usual (ours)."""
_TIMES_USUAL = 3.0
"""Least ratio of a contradiction to the usual disagreement (ours)."""
_NEIGHBOURS = 16
"""Number of neighbours beyond a gap that are compared with each node before the gap."""


@dataclass(frozen=True, slots=True)
class ContradictedEdge:
    """An edge whose waypoint disagrees with odometry."""

    edge: EdgeKey
    length_m: float
    """Straight distance of the edge's ends by its waypoint, in metres."""
    odometry_m: float
    """Distance of the edge's ends by odometry, in metres."""
    gap_m: float
    """Distance between the edge's target by its waypoint and by odometry, in metres."""


@dataclass(frozen=True, slots=True)
class NearPair:
    """Two nodes near each other, one on each side of a gap."""

    edge: EdgeKey
    """Edge from the start's side of the gap to the goal's side."""
    distance: float
    """d by odometry, Eq. 2."""


@dataclass(frozen=True, slots=True)
class MapGap:
    """Two parts of a map, without a path from the first to the second."""

    start: NodeId
    goal: NodeId
    reached: int
    """Number of nodes that can be reached from the start, including the start."""
    leading: int
    """Number of nodes with a path to the goal, including the goal."""
    nearest: tuple[NearPair, ...]
    """Nearest pairs of nodes across the gap, the nearest first; empty if odometry never moves."""


def contradicted_edges(graph: TopologicalGraph) -> tuple[ContradictedEdge, ...]:
    """Return the edges that odometry contradicts much more than the other edges of the map, the worst first; linear.

    In a map of several drives with independent odometry, many edges disagree, and none of them stands out.
    """
    edges = graph.driven_edges
    if not edges:
        return ()
    driven = relative(*(_odometry(graph, ends) for ends in zip(*edges, strict=True)))
    claimed = np.array([edge.waypoint for edge in edges.values()], np.float64)
    gaps_m = np.hypot(*(driven - claimed)[:, :2].T)
    limit_m = max(_LEAST_GAP_M, _TIMES_USUAL * float(np.quantile(gaps_m, _USUAL_QUANTILE)))
    found = [
        ContradictedEdge(
            edge=key,
            length_m=float(np.hypot(*claimed[row, :2])),
            odometry_m=float(np.hypot(*driven[row, :2])),
            gap_m=float(gaps_m[row]),
        )
        for row, key in enumerate(edges)
        if gaps_m[row] > limit_m
    ]
    return tuple(sorted(found, key=lambda each: -each.gap_m))


def map_gap(graph: TopologicalGraph, start: NodeId, goal: NodeId, *, most: int = 5) -> MapGap | None:
    """Return the gap between two nodes; None if there is a path, or if a node is missing.

    Linear in the edges, plus one nearest-neighbour search for each node that can be reached.
    """
    if start not in graph.nodes or goal not in graph.nodes:
        return None
    mirror, index = mirrored(graph, graph.edges)
    reached = [start, *(mirror[k] for k in sorted(rustworkx.descendants(mirror, index[start])))]
    if goal in reached:
        return None
    leading = [goal, *(mirror[k] for k in sorted(rustworkx.ancestors(mirror, index[goal])))]
    return MapGap(
        start=start,
        goal=goal,
        reached=len(reached),
        leading=len(leading),
        nearest=_nearest(graph, reached, leading)[:most],
    )


def _nearest(graph: TopologicalGraph, reached: Sequence[NodeId], leading: Sequence[NodeId]) -> tuple[NearPair, ...]:
    here = _odometry(graph, reached)
    there = _odometry(graph, leading)
    if not np.ptp(np.concatenate([here, there])[:, :2], axis=0).any():
        return ()
    count = min(_NEIGHBOURS, len(leading))
    # With one neighbour, the search returns (N,).
    beyond = np.asarray(KDTree(there[:, :2]).query(here[:, :2], k=count)[1]).reshape(-1, count)
    gaps = distance(relative(here[:, None], there[beyond]))
    pairs = [
        NearPair(edge=(reached[row], leading[column]), distance=float(gap))
        for row, columns in enumerate(beyond.tolist())
        for column, gap in zip(columns, gaps[row], strict=True)
    ]
    return tuple(sorted(pairs, key=lambda pair: pair.distance))


def _odometry(graph: TopologicalGraph, nodes: Sequence[NodeId]) -> Pose:
    """Return the poses (N, 3) of the nodes by odometry."""
    return np.array([graph.nodes[node].odometry for node in nodes], np.float64).reshape(-1, 3)
