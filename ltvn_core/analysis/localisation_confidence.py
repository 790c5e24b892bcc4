"""How sure the localisation of the robot is, and which places look alike.

Owns the numbers behind the heat map, the current view compared with every node, and the search for perceptual aliases,
from the map and its odometry. Every false edge of a map joins such a pair, and most wrong localisations confuse one.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import rustworkx
from numpy.typing import NDArray

from ltvn_core.analysis.image_similarity import colour_descriptors
from ltvn_core.config import BuildingConfig, LocalisingConfig, Method
from ltvn_core.graph.localiser import near_enough, resemblance
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import Features, NodeId, Observation, Predictor


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationHeatMap:
    """One view compared with N nodes."""

    nodes: tuple[NodeId, ...]
    """The N nodes."""
    distances: NDArray[np.float64]
    """(N,): d to each node, Eq. 2; infinite where the predictor did not compare the pair in full."""
    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    scores: NDArray[np.float64]
    """(N,): d - 1.5 ln r; the lowest is the most alike. Temporal support is not included."""
    near: NDArray[np.bool_]
    """(N,): whether d < D_l and r is above the localiser's limit, so that the robot may be at the node."""

    def best(self, count: int) -> tuple[NodeId, ...]:
        """Return the `count` nodes with the lowest scores, best first."""
        return tuple(self.nodes[k] for k in np.argsort(self.scores, kind="stable")[:count])

    @property
    def margin(self) -> float:
        """Score of the second best minus score of the best; infinite with fewer than two nodes."""
        if len(self.nodes) < 2:
            return float("inf")
        first, second = np.partition(self.scores, 1)[:2]
        return float(second - first) if np.isfinite(first) else 0.0


def localisation_heat_map(
    features: Features, nodes: Sequence[NodeId], matcher: Matcher, config: LocalisingConfig
) -> LocalisationHeatMap:
    """Compare a view (1, F) with every node in one batch, for a heat map.

    Costs one match with N nodes; their features come from the matcher's keyframes. The result is empty without nodes.
    """
    found = matcher.match(features, nodes)
    return LocalisationHeatMap(
        nodes=found.nodes,
        distances=found.distances,
        reachability=found.reachability,
        scores=resemblance(found),
        near=near_enough(found, config),
    )


def features_of(observation: Observation, matcher: Matcher, predictor: Predictor) -> Features:
    """Return the features (1, F) of a view; it is encoded only if the matcher's keyframes do not hold it."""
    keyframes = matcher.keyframes
    return keyframes.features([observation.step]) if observation.step in keyframes else predictor.encode([observation])


_DRIFT = BuildingConfig().odometry_drift
"""Odometry drift to allow for if the method itself does not use odometry."""
_FAR_FACTOR = 4.0
"""Multiple of D_l above which two nodes are far apart in the map."""
_ROWS = 512


@dataclass(frozen=True, slots=True)
class PerceptualAlias:
    """Two nodes that are near each other by the network, but far apart by odometry or the map."""

    first: NodeId
    second: NodeId
    reachability: float
    """r of the direction with the higher r; with support by neighbouring frames if the method requires it."""
    distance: float
    """d predicted by the network, Eq. 2."""
    odometry_m: float
    """Straight distance by odometry, in metres."""
    contradicted_by_odometry: bool
    """Whether odometry contradicts the predicted waypoint, even with its drift allowed for."""
    path_length: float
    """Length of the shortest path through the map, in the shorter direction; infinite without one. Edges whose ends are
    far apart by odometry are left out, so that a false edge is no evidence for itself."""
    has_edge: bool
    """Whether an edge joins the nodes; it is false, unless the odometry is wrong."""

    @property
    def sentence(self) -> str:
        """The contradiction in one line."""
        claim = f"{self.first} and {self.second} look {self.distance:.2f} apart (r {self.reachability:.2f})"
        rest = "rest of the " if self.has_edge else ""
        way = (
            f"{self.path_length:.1f} through the {rest}map" if math.isfinite(self.path_length) else "no path in the map"
        )
        edge = ", and an edge joins them" if self.has_edge else ""
        return f"{claim}, yet they are {self.odometry_m:.1f} m apart by odometry, {way}{edge}."


def find_perceptual_aliases(
    graph: TopologicalGraph,
    matcher: Matcher,
    method: Method,
    *,
    candidates: int | None = 16,
) -> tuple[PerceptualAlias, ...]:
    """Return the pairs that are near by r and d < D_l but far by odometry or map: false edges first, then by r.

    Each node is compared with its neighbours in the map, and with the `candidates` nodes that have the most similar
    images and are not near it by odometry; with None, all nodes are compared. Costs N (candidates + degree) network
    comparisons of cached features, N^2 products of small descriptors, and one Dijkstra search for each node of a found
    pair. Raises MapError if an image of a node is missing.
    """
    nodes = tuple(graph.nodes)
    if len(nodes) < 2:
        return ()
    odometry_gate = _odometry_gate(matcher, method)
    found: dict[tuple[NodeId, NodeId], PerceptualAlias] = {}
    for k, others in enumerate(_others(graph, matcher, method.localising.distance, candidates)):
        for pair in _near(graph, matcher, odometry_gate, method, nodes[k], others):
            key = pair.first, pair.second
            if key not in found or pair.reachability > found[key].reachability:
                found[key] = pair
    return _contradicted_aliases(graph, tuple(found.values()), _FAR_FACTOR * method.localising.distance)


def _odometry_gate(matcher: Matcher, method: Method) -> OdometryGate:
    """Return the check against odometry, even if the method does not use odometry."""
    drift = method.building.odometry_drift or _DRIFT
    seen = [matcher.keyframes.observation(frame) for frame in matcher.keyframes.frames]
    return OdometryGate(seen, replace(method.building, odometry_drift=drift))


def _others(
    graph: TopologicalGraph, matcher: Matcher, near: float, candidates: int | None
) -> Iterator[tuple[NodeId, ...]]:
    """Yield for each node, in order, the nodes to compare it with."""
    nodes = tuple(graph.nodes)
    if candidates is None:
        yield from ((*nodes[:k], *nodes[k + 1 :]) for k in range(len(nodes)))
        return
    places = np.array([node.odometry[:2] for node in graph.nodes.values()])
    descriptors = colour_descriptors(matcher.keyframes, nodes).astype(np.float32)
    for first in range(0, len(nodes), _ROWS):
        rows = slice(first, first + _ROWS)
        beside = np.hypot(*(places[rows, None] - places[None]).transpose(2, 0, 1)) < 2 * near
        for k, row in enumerate(np.where(beside, -np.inf, descriptors[rows] @ descriptors.T), start=first):
            alike = (nodes[j] for j in _top(row, candidates))
            yield tuple(dict.fromkeys([*graph.successors(nodes[k]), *alike]))


def _top(row: NDArray[np.float32], count: int) -> NDArray[np.intp]:
    """Return the indices of the `count` greatest finite values of (N,)."""
    best = np.argpartition(-row, count)[:count] if count < len(row) else np.arange(len(row))
    return best[np.isfinite(row[best])]


def _near(
    graph: TopologicalGraph,
    matcher: Matcher,
    odometry_gate: OdometryGate,
    method: Method,
    node: NodeId,
    others: Sequence[NodeId],
) -> Iterator[PerceptualAlias]:
    """Yield the nodes that are near by the network, with support by neighbouring frames if the method requires it."""
    claims = matcher.match(matcher.keyframes.features([node]), others)
    claims = claims.take(_within(claims, method))
    claims = matcher.with_mutual_support(claims, node)
    claims = claims.take(_within(claims, method))
    plausible = odometry_gate.plausible(node, claims)
    here = np.array(graph.nodes[node].odometry[:2])
    for k, other in enumerate(claims.nodes):
        apart = float(np.hypot(*(here - graph.nodes[other].odometry[:2])))
        has_edge = (node, other) in graph.edges or (other, node) in graph.edges
        yield PerceptualAlias(
            first=min(node, other),
            second=max(node, other),
            reachability=float(claims.reachability[k]),
            distance=float(claims.distances[k]),
            odometry_m=apart,
            contradicted_by_odometry=not plausible[k],
            path_length=math.inf,
            has_edge=has_edge,
        )


def _within(claims: Matches, method: Method) -> NDArray[np.bool_]:
    return (claims.distances < method.localising.distance) & (claims.reachability > method.localising.reachability)


def _contradicted_aliases(
    graph: TopologicalGraph, pairs: Sequence[PerceptualAlias], far: float
) -> tuple[PerceptualAlias, ...]:
    """Return the pairs that odometry contradicts or the map puts far apart, with the length of their path in the map.

    An edge is no evidence for itself: if its ends are far apart by odometry, the path is measured without it.
    """
    doubted = {_ends(pair) for pair in pairs if pair.has_edge and pair.odometry_m > far / 2}
    odd = [pair for pair in pairs if pair.contradicted_by_odometry or not pair.has_edge or _ends(pair) in doubted]
    lengths = _lengths(graph, {node for pair in odd for node in _ends(pair)}, doubted)
    far_ones = []
    for pair in odd:
        first, second = _ends(pair)
        length = min(lengths[first].get(second, math.inf), lengths[second].get(first, math.inf))
        if pair.contradicted_by_odometry or length > far:
            far_ones.append(replace(pair, path_length=length))
    return tuple(
        sorted(far_ones, key=lambda pair: (not pair.has_edge, not pair.contradicted_by_odometry, -pair.reachability))
    )


def _ends(pair: PerceptualAlias) -> EdgeKey:
    return pair.first, pair.second


def _lengths(graph: TopologicalGraph, sources: set[NodeId], doubted: set[EdgeKey]) -> dict[NodeId, dict[NodeId, float]]:
    """Return the lengths, by mu, of the shortest paths from each source without doubted edges."""
    mirror: rustworkx.PyDiGraph[NodeId, float] = rustworkx.PyDiGraph(multigraph=False)
    index = dict(zip(graph.nodes, mirror.add_nodes_from(list(graph.nodes)), strict=True))
    mirror.add_edges_from(
        [
            (index[a], index[b], edge.belief.mu)
            for (a, b), edge in graph.edges.items()
            if (min(a, b), max(a, b)) not in doubted
        ]
    )
    return {
        source: {
            mirror[k]: length
            for k, length in rustworkx.dijkstra_shortest_path_lengths(mirror, index[source], float).items()
        }
        for source in sources
    }
