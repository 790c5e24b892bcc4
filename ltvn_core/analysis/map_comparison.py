"""The difference of two maps, or of one map at two times: what only one has, what changed, and how much it matters.

Owns the difference, the figures, and the matching of nodes: by image if both maps come from one trajectory, otherwise
by the nearest place. The importance of an edge is its betweenness, the share of all cheapest paths that use it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.planner import cost_matrix, strongly_connected_components
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Collided, Judged, Outcome, QueryEnded, StampedEvent
from ltvn_core.types import NodeId, Pose

MAX_MATCH_DISTANCE = 0.75
"""Greatest d, Eq. 2, of two nodes that can be the same: half a metre and 20 degrees (ours)."""
_SOURCES = 32
"""Number of nodes from which paths are counted; more would take longer."""


class MatchedBy(StrEnum):
    """How the nodes of two maps were matched."""

    ID = "id"
    """Both maps come from one trajectory, and a node is named after its image."""
    POSE = "pose"
    """The maps come from two trajectories, and nodes with the nearest poses are the same."""


def match_nodes(
    a: TopologicalGraph, b: TopologicalGraph, poses_a: Mapping[NodeId, Pose], poses_b: Mapping[NodeId, Pose]
) -> tuple[MatchedBy, dict[NodeId, NodeId]]:
    """Match nodes by id if the maps come from one trajectory, otherwise each to its nearest node if that is mutual.

    Poses (3,) are the given ones, for instance exact ones in simulation, otherwise those of the odometry, which match
    only if both drives began at the same place. No node occurs twice. Takes O(N log N).
    """
    shared = [node for node in a.nodes if node in b.nodes and a.nodes[node].odometry == b.nodes[node].odometry]
    if len(shared) * 2 >= min(len(a.nodes), len(b.nodes)):
        return MatchedBy.ID, {node: node for node in shared}
    return MatchedBy.POSE, _nearest(_node_poses(a, poses_a), _node_poses(b, poses_b))


def _node_poses(graph: TopologicalGraph, given: Mapping[NodeId, Pose]) -> dict[NodeId, Pose]:
    """Return a pose (3,) for each node: the given one, otherwise that of the odometry."""
    return {node: given.get(node, np.array(value.odometry, np.float64)) for node, value in graph.nodes.items()}


def _nearest(a: Mapping[NodeId, Pose], b: Mapping[NodeId, Pose]) -> dict[NodeId, NodeId]:
    if not a or not b:
        return {}
    names = list(a)
    others = list(b)
    first = np.array(list(a.values()))
    second = np.array(list(b.values()))
    to_second = np.asarray(KDTree(_embedded(second)).query(_embedded(first))[1])
    to_first = np.asarray(KDTree(_embedded(first)).query(_embedded(second))[1])
    mutual = np.flatnonzero(to_first[to_second] == np.arange(len(names)))
    near = mutual[distance(relative(first[mutual], second[to_second[mutual]])) <= MAX_MATCH_DISTANCE]
    return {names[k]: others[int(to_second[k])] for k in near.tolist()}


def _embedded(poses: Pose) -> np.ndarray:
    """Return points (N, 4) for poses (N, 3), so that the distance of two points is close to d for small turns."""
    turn = np.sqrt(2) * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    return np.concatenate([poses[:, :2], turn], axis=1)


def edge_betweenness(graph: TopologicalGraph) -> Mapping[EdgeKey, float]:
    """Return for each edge the share in [0, 1] of the cheapest paths that use it; unused edges are left out.

    The paths lead from `_SOURCES` nodes, evenly spread over the order of the nodes, to all nodes; the cost is mu, as in
    the paper. Takes O(starts * (edges + nodes) log nodes): about two seconds for 50,000 edges.
    """
    nodes, costs = cost_matrix(graph, lambda belief: belief.mu)
    if len(nodes) < 2:
        return {}
    starts = np.unique(np.linspace(0, len(nodes) - 1, min(_SOURCES, len(nodes))).astype(np.intp))
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


def _paths_below(lengths: NDArray[np.float64], before: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return for each node (N,) the number of paths that contain it, in one tree of cheapest paths."""
    below = np.isfinite(lengths).astype(np.intp)
    for node in np.argsort(-np.where(np.isfinite(lengths), lengths, -1.0), kind="stable").tolist():
        if before[node] >= 0:
            below[before[node]] += below[node]
    return below


@dataclass(frozen=True, slots=True)
class EdgeDifference:
    """An edge that differs between two maps."""

    a: Edge | None
    """The edge in the first map; None if it is missing there."""
    b: Edge | None
    """The edge in the second map; None if it is missing there."""
    betweenness: float
    """Share of the cheapest paths that use the edge, in the map where this share is higher."""

    @property
    def change_of_p(self) -> float:
        """p in the second map minus p in the first; a missing edge has p = 0."""
        p, q = (0.0 if edge is None else edge.belief.p for edge in (self.a, self.b))
        return q - p

    @property
    def importance(self) -> float:
        """|change of p| times `betweenness`."""
        return abs(self.change_of_p) * self.betweenness


@dataclass(frozen=True, slots=True)
class MapDifference:
    """Common and different nodes and edges of two maps."""

    matched_by: MatchedBy
    nodes: Mapping[NodeId, NodeId]
    """Nodes in both maps: node of the first map to node of the second."""
    nodes_only_a: tuple[NodeId, ...]
    """Nodes that only the first map has."""
    nodes_only_b: tuple[NodeId, ...]
    """Nodes that only the second map has."""
    edges: Mapping[EdgeKey, EdgeKey]
    """Edges in both maps: edge of the first map to edge of the second."""
    edges_only_a: tuple[EdgeKey, ...]
    edges_only_b: tuple[EdgeKey, ...]
    differing: tuple[EdgeDifference, ...]
    """Edges in one map only, and edges whose belief or counts changed; the most important first."""


@dataclass(frozen=True, slots=True)
class MapMetrics:
    """The size of a map, and the results of the queries in its recording."""

    nodes: int
    edges: int
    strongly_connected_components: int
    mean_p: float | None
    """Mean p of the edges; None without edges."""
    queries: int
    """Number of queries that ended."""
    arrived: int
    """Number of arrivals by the robot's own judgement."""
    reached: int | None
    """Number of successes by the paper's criterion; None if unknown."""
    collisions: int
    """Collisions so far, including those of an unfinished query."""


def compare_maps(
    a: TopologicalGraph,
    b: TopologicalGraph,
    *,
    poses_a: Mapping[NodeId, Pose] | None = None,
    poses_b: Mapping[NodeId, Pose] | None = None,
) -> MapDifference:
    """Return the difference of two maps; see `match_nodes` and `edge_betweenness` for poses and cost."""
    matched_by, there = match_nodes(a, b, poses_a or {}, poses_b or {})
    common = {
        key: other
        for key in a.edges
        if key[0] in there and key[1] in there and (other := (there[key[0]], there[key[1]])) in b.edges
    }
    in_b = set(common.values())
    met = set(there.values())
    only_a = tuple(key for key in a.edges if key not in common)
    only_b = tuple(key for key in b.edges if key not in in_b)
    pairs = [(key, other) for key, other in common.items() if _differs(a.edges[key], b.edges[other])]
    pairs += [(key, None) for key in only_a]
    pairs += [(None, other) for other in only_b]
    return MapDifference(
        matched_by=matched_by,
        nodes=there,
        nodes_only_a=tuple(node for node in a.nodes if node not in there),
        nodes_only_b=tuple(node for node in b.nodes if node not in met),
        edges=common,
        edges_only_a=only_a,
        edges_only_b=only_b,
        differing=_by_importance(a, b, pairs),
    )


def map_metrics(graph: TopologicalGraph, events: Sequence[StampedEvent] = ()) -> MapMetrics:
    """Return the size of a map and the results of its queries; linear in edges and events."""
    p = [edge.belief.p for edge in graph.edges.values()]
    ended = [stamped.event for stamped in events if isinstance(stamped.event, QueryEnded)]
    verdicts = [stamped.event.reached for stamped in events if isinstance(stamped.event, Judged)]
    return MapMetrics(
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        strongly_connected_components=len(strongly_connected_components(graph)),
        mean_p=sum(p) / len(p) if p else None,
        queries=len(ended),
        arrived=sum(end.outcome is Outcome.ARRIVED for end in ended),
        reached=sum(verdicts) if verdicts else None,
        collisions=sum(isinstance(stamped.event, Collided) for stamped in events),
    )


def _by_importance(
    a: TopologicalGraph,
    b: TopologicalGraph,
    pairs: Sequence[tuple[EdgeKey | None, EdgeKey | None]],
) -> tuple[EdgeDifference, ...]:
    if not pairs:
        return ()
    busy_a, busy_b = map(edge_betweenness, (a, b))
    found = []
    for key, other in pairs:
        first = None if key is None else a.edges[key]
        second = None if other is None else b.edges[other]
        betweenness = max(
            0.0 if key is None else busy_a.get(key, 0.0), 0.0 if other is None else busy_b.get(other, 0.0)
        )
        found.append(EdgeDifference(first, second, betweenness))
    return tuple(sorted(found, key=lambda each: (-each.importance, -abs(each.change_of_p))))


def _differs(first: Edge, second: Edge) -> bool:
    return (first.belief, first.attempts, first.successes) != (second.belief, second.attempts, second.successes)
