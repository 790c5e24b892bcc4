"""The localisation of PlaceNav (Suomela et al. 2024): a discrete Bayes filter over the nodes, on our own map.

Owns that filter. A belief over the nodes moves along the edges as the robot does, and each image weighs it by how much
it resembles the nodes; the robot is where the belief is greatest, so one image that resembles another place does not
carry it off. Their states are the images of one route, and the robot moves 2 back to 10 ahead; a sparse map has one
node for several images, so here it is a step or two along edges (ours). How sharply an image weighs is set from the
spread of likeness over the first one, as they do (Xu et al. 2021).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.graph.localiser import GLOBAL, LOCAL, Localisation, LocalisationPrior, best_localisation, doubt
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.entry import SystemEntry
from ltvn_core.types import Features, NodeId

STEPS_ALONG_EDGES = 2
"""From one image to the next the robot may go so far."""
QUANTILES, RATIO = (0.025, 0.975), 5.0
"""Between nodes at these quantiles of likeness one image makes a difference of this factor."""
_FAR = 3.0
"""Nodes that are farther by d count as so far."""


def placenav_system(method: Method) -> NavigationSystem:
    """Return our own system with this localisation; `method` has all thresholds."""
    return replace(ltvn_system(method), name="placenav", localise=BayesFilter(), follows_places=False)


@dataclass(frozen=True, slots=True)
class _Belief:
    of: Mapping[NodeId, float]
    sharpness: float


class BayesFilter:
    """Follows the robot through one query after the other; a query begins with no plan, and so does its belief."""

    def __init__(self) -> None:
        """Know nothing."""
        self._belief: _Belief | None = None

    def __call__(
        self, features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
    ) -> Localisation:
        """Return the node of the greatest belief; it may not be one that is doubted."""
        nodes = prior.candidates(graph)
        matches = matcher.match(features, nodes)
        # Their descriptors tell near from nearer; where r is the same, the length of the waypoint does.
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
    """Return (N,) the belief after a move: spread evenly over all nodes that the robot may have come to."""
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


PLACENAV = SystemEntry(name="placenav", label="PlaceNav", factory=placenav_system, preset_in_label=True)
