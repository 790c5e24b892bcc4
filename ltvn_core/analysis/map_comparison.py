"""The difference of two maps, or of one map at two times: what only one has, what changed, and how much it matters.

Owns the difference and the figures. Which node is which is `node_matching`; how much an edge matters is
`edge_betweenness`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ltvn_core.analysis.edge_betweenness import edge_betweenness
from ltvn_core.analysis.node_matching import MatchedBy, match_nodes
from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.planner import EdgeWeight
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Collided, Judged, Outcome, QueryEnded, StampedEvent
from ltvn_core.types import NodeId, Pose


@dataclass(frozen=True, slots=True)
class EdgeDifference:
    """An edge that is not the same in both maps."""

    a: Edge | None
    """As the first map has it; None if it has not."""
    b: Edge | None
    """As the second map has it; None if it has not."""
    betweenness: float
    """Share of cheapest paths that run over it, in the map where that is more."""

    @property
    def change_of_p(self) -> float:
        """p in the second map minus p in the first; an edge that is not there has p = 0."""
        p, q = (0.0 if edge is None else edge.belief.p for edge in (self.a, self.b))
        return q - p

    @property
    def importance(self) -> float:
        """|change of p| times `betweenness`."""
        return abs(self.change_of_p) * self.betweenness


@dataclass(frozen=True, slots=True)
class MapDifference:
    """What two maps have in common and what not."""

    matched_by: MatchedBy
    nodes: Mapping[NodeId, NodeId]
    """Nodes in both: of the first map to that of the second."""
    nodes_only_a: tuple[NodeId, ...]
    """Nodes of the first map alone."""
    nodes_only_b: tuple[NodeId, ...]
    """Nodes of the second map alone."""
    edges: Mapping[EdgeKey, EdgeKey]
    """Edges in both."""
    edges_only_a: tuple[EdgeKey, ...]
    edges_only_b: tuple[EdgeKey, ...]
    differing: tuple[EdgeDifference, ...]
    """Edges in one map only, and those whose belief or counts changed; what matters most comes first."""


@dataclass(frozen=True, slots=True)
class MapMetrics:
    """A map in numbers, and the queries of its recording."""

    nodes: int
    edges: int
    reserve: int
    strongly_connected_components: int
    mean_p: float | None
    """None without edges."""
    queries: int
    """Queries that ended."""
    arrived: int
    """By the robot's own judgement."""
    reached: int | None
    """By the paper's criterion; None where nobody judged."""
    collisions: int
    """Touches so far, those too of a query that is not over."""


def compare_maps(
    a: TopologicalGraph,
    b: TopologicalGraph,
    *,
    poses_a: Mapping[NodeId, Pose] | None = None,
    poses_b: Mapping[NodeId, Pose] | None = None,
    weight: EdgeWeight | None = None,
) -> MapDifference:
    """Return the difference of two maps, see `match_nodes` and `edge_betweenness` for poses, weight and cost."""
    matching = match_nodes(a, b, poses_a=poses_a, poses_b=poses_b)
    there = matching.pairs
    common = {
        key: other
        for key in a.edges
        if key[0] in there and key[1] in there and (other := (there[key[0]], there[key[1]])) in b.edges
    }
    in_b, met = set(common.values()), set(there.values())
    only_a = tuple(key for key in a.edges if key not in common)
    only_b = tuple(key for key in b.edges if key not in in_b)
    pairs = [(key, other) for key, other in common.items() if _differs(a.edges[key], b.edges[other])]
    pairs += [(key, None) for key in only_a]
    pairs += [(None, other) for other in only_b]
    return MapDifference(
        matched_by=matching.matched_by,
        nodes=there,
        nodes_only_a=tuple(node for node in a.nodes if node not in there),
        nodes_only_b=tuple(node for node in b.nodes if node not in met),
        edges=common,
        edges_only_a=only_a,
        edges_only_b=only_b,
        differing=_by_importance(a, b, pairs, weight),
    )


def map_metrics(graph: TopologicalGraph, events: Sequence[StampedEvent] = ()) -> MapMetrics:
    """Count a map and the queries of its recording; linear in edges and events."""
    p = [edge.belief.p for edge in graph.edges.values()]
    ended = [stamped.event for stamped in events if isinstance(stamped.event, QueryEnded)]
    verdicts = [stamped.event.reached for stamped in events if isinstance(stamped.event, Judged)]
    return MapMetrics(
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        reserve=len(graph.reserve),
        strongly_connected_components=count_strongly_connected_components(graph),
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
    weight: EdgeWeight | None,
) -> tuple[EdgeDifference, ...]:
    if not pairs:
        return ()
    busy_a, busy_b = (edge_betweenness(graph, weight=weight) for graph in (a, b))
    found = []
    for key, other in pairs:
        first, second = (None if key is None else a.edges[key]), (None if other is None else b.edges[other])
        betweenness = max(
            0.0 if key is None else busy_a.get(key, 0.0), 0.0 if other is None else busy_b.get(other, 0.0)
        )
        found.append(EdgeDifference(first, second, betweenness))
    return tuple(sorted(found, key=lambda each: (-each.importance, -abs(each.change_of_p))))


def _differs(first: Edge, second: Edge) -> bool:
    return (first.belief, first.attempts, first.successes) != (second.belief, second.attempts, second.successes)
