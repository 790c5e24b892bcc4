"""The localisation of PlaceNav (Suomela et al. 2024): a discrete Bayes filter over the nodes, on our own map.

Owns that filter. The belief over the nodes is propagated along the edges, and each image updates it by its similarity
to the nodes. The robot is at the node with the highest belief, so a single image that resembles another place does not
mislead it. In PlaceNav, states are the images of one route, and the motion model allows 2 images back to 10 ahead; a
sparse map has one node for several images, so here the robot moves up to two edges (ours). The sharpness of the update
is set from the spread of similarities for the first image, as in PlaceNav (Xu et al. 2021).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.localiser import GLOBAL, LOCAL, Localisation, LocalisationPrior, best_localisation, doubt
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, NodeId

STEPS_ALONG_EDGES = 2
"""Largest number of edges along which the robot moves between two images."""
QUANTILES, RATIO = (0.025, 0.975), 5.0
"""Ratio of the likelihoods of one image at these quantiles of similarity, which sets the sharpness."""
_FAR = 3.0
"""Upper limit to which d of nodes is clipped."""


@dataclass(frozen=True, slots=True)
class _Belief:
    of: Mapping[NodeId, float]
    sharpness: float


class BayesFilter:
    """Tracks the robot through all queries; a query without a plan is new and resets the belief."""

    def __init__(self) -> None:
        """Start without a belief."""
        self._belief: _Belief | None = None

    def __call__(
        self, features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
    ) -> Localisation:
        """Return the node with the highest belief, except doubted ones."""
        nodes = prior.candidates(graph)
        matches = matcher.match(features, nodes)
        # PlaceNav ranks near nodes by its descriptors; here the waypoint's length ranks them, because r saturates.
        unlikeness = doubt(matches.reachability) + np.minimum(matches.distances, _FAR)
        if not prior.plan:
            self._belief = None
        scope = GLOBAL if self._belief is None else LOCAL
        sharpness = _sharpness(unlikeness) if self._belief is None else self._belief.sharpness
        before = np.ones(len(nodes)) if self._belief is None else _moved(self._belief.of, nodes, graph)
        weights = before * np.exp(-sharpness * (unlikeness - unlikeness.min(initial=np.inf)))
        if not weights.sum() > 0:
            self._belief = None
            return best_localisation(matches, unlikeness, np.zeros(len(nodes), bool), scope)
        belief = weights / weights.sum()
        self._belief = _Belief(dict(zip(nodes, belief.tolist(), strict=True)), sharpness)
        return best_localisation(matches, -belief, np.isfinite(matches.distances), scope)


def _sharpness(unlikeness: NDArray[np.float64]) -> float:
    low, high = np.quantile(unlikeness, QUANTILES) if len(unlikeness) else (0.0, 1.0)
    return float(np.log(RATIO) / max(high - low, 1e-6))


def _moved(belief: Mapping[NodeId, float], nodes: Sequence[NodeId], graph: TopologicalGraph) -> NDArray[np.float64]:
    """Return the belief (N,) after a move: spread evenly over all nodes that the robot may have reached."""
    spread = dict.fromkeys(nodes, 0.0)
    for node, weight in belief.items():
        if node not in graph.nodes:
            continue
        reached = {node}
        for _ in range(STEPS_ALONG_EDGES):
            reached |= {after for each in reached for after in graph.successors(each)}
        for each in reached & spread.keys():
            spread[each] += weight / len(reached)
    return np.array([spread[node] for node in nodes])
