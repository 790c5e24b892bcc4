"""Where am I: the node that looks nearest to the current image, first around the last plan, then in the whole map.

Owns the score and the gates. Does not own what happens when no node is near enough.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Localising
from ltvn_core.graph.closures import Closures, Standard, Stretch
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.types import Features, NodeId, Waypoint

LOCAL, GLOBAL = "local", "global"
_LEAST_R = 1e-6
_FEWEST_LOOKS, _FEWEST_TO_BLAME = 3, 5
"""So many looks must bear on a place before it is passed over, and before an edge that led there is blamed."""


@dataclass(frozen=True, slots=True, eq=False)
class Recall:
    """What the robot remembers of the query that helps to tell where it is."""

    plan: Sequence[NodeId] = ()
    """The nodes of the last plan."""
    trail: Stretch | None = None
    """What it saw on its way here."""
    doubted: Collection[NodeId] = ()
    """Nodes that it does not believe to be at any more."""

    def candidates(self, graph: TopologicalGraph) -> tuple[NodeId, ...]:
        """Return all nodes it may be at."""
        return tuple(node for node in graph.nodes if node not in self.doubted)


NOTHING = Recall()
"""At the beginning of a query."""


class Fix(NamedTuple):
    """The best node, and how sure that is."""

    node: NodeId | None
    """None when no node is near enough."""
    distance: float
    """d of the best node, near enough or not; infinite in an empty map."""
    reachability: float
    waypoint: Waypoint
    """(3,): the best node in the robot's frame."""
    runner_up: NodeId | None
    margin: float
    """Score of the runner-up minus score of the best; infinite without a runner-up."""
    scope: str
    """LOCAL or GLOBAL."""


class Localizer:
    """Compares the current image with the map."""

    def __init__(self, matcher: Matcher, config: Localising) -> None:
        """Localise with `matcher`."""
        self._matcher = matcher
        self._config = config
        self._closures = Closures(matcher)

    def localise(self, image: Features, graph: TopologicalGraph, recall: Recall = NOTHING) -> Fix:
        """Return where the image (1, F) is: a neighbour of the last plan if one is near enough, else any node."""
        nearby = [node for node in around(graph, recall.plan) if node not in recall.doubted]
        if nearby:
            fix = self._best_of(nearby, image, recall, LOCAL)
            if fix.node is not None:
                return fix
        return self._best_of(recall.candidates(graph), image, recall, GLOBAL)

    def _best_of(self, nodes: Sequence[NodeId], image: Features, recall: Recall, scope: str) -> Fix:
        matches = self._believable(image, self._matcher.match(image, nodes))
        if recall.trail is not None:
            matches = self._on_the_way(matches, recall.trail)
        return self._best(matches, scope)

    def nearest_nodes(self, image: Features, graph: TopologicalGraph, count: int) -> tuple[tuple[NodeId, float], ...]:
        """Return the `count` nodes that look most like the image (1, F), best first, with their reachability."""
        matches = self._matcher.match(image, tuple(graph.nodes))
        order = np.argsort(self._scores(matches), kind="stable")[:count]
        return tuple((matches.nodes[k], float(matches.reachability[k])) for k in order)

    def _scores(self, matches: Matches) -> np.ndarray:
        doubt = -np.log(np.maximum(matches.reachability, _LEAST_R))
        return matches.distances + self._config.reachability_weight * doubt

    def _near_enough(self, matches: Matches) -> np.ndarray:
        return (matches.distances < self._config.distance) & (matches.reachability > self._config.reachability)

    def _believable(self, image: Features, matches: Matches) -> Matches:
        """Lower r of the best nodes to what their neighbours in time confirm; the rest cannot win any more."""
        candidates = np.flatnonzero(self._near_enough(matches))
        if not self._config.shortlist or not len(candidates):
            return matches
        order = np.argsort(self._scores(matches)[candidates], kind="stable")
        return self._matcher.witnessed(matches.take(candidates[order[: self._config.shortlist]]), image)

    def _on_the_way(self, matches: Matches, trail: Stretch) -> Matches:
        """Take all trust from the best nodes up to the first that fits to the way here."""
        candidates = np.flatnonzero(self._near_enough(matches))
        trusted = matches.reachability.copy()
        for k in candidates[np.argsort(self._scores(matches)[candidates], kind="stable")]:
            if on_the_way(self._closures, trail, matches.nodes[k], matches.waypoints[k], self._config):
                break
            trusted[k] = 0.0
        return matches.with_reachability(trusted)

    def _best(self, matches: Matches, scope: str) -> Fix:
        return best_fix(matches, self._scores(matches), self._near_enough(matches), scope)


def on_the_way(
    closures: Closures,
    trail: Stretch | None,
    node: NodeId,
    waypoint: Waypoint,
    config: Localising,
    *,
    to_blame: bool = False,
) -> bool:
    """Tell whether a node seen at `waypoint` (3,) may be there, after all that was seen on the way here.

    More must speak against it where an edge is `to_blame`.
    """
    fewest = _FEWEST_TO_BLAME if to_blame else _FEWEST_LOOKS
    standard = Standard(config.trail_reach, config.trail_share, fewest)
    return trail is None or not config.trail_reach or closures.fits(trail, node, waypoint, standard)


def fit_the_way(matcher: Matcher, trail: Stretch | None, matches: Matches, config: Localising) -> NDArray[np.bool_]:
    """Tell (N,) which matches may be where they seem, after all that was seen on the way here."""
    closures = Closures(matcher)
    pairs = zip(matches.nodes, matches.waypoints, strict=True)
    return np.array([on_the_way(closures, trail, *pair, config) for pair in pairs], bool)


def best_fix(matches: Matches, scores: NDArray[np.float64], passing: NDArray[np.bool_], scope: str) -> Fix:
    """Return the match with the lowest score (N,) among those that pass (N,), and how sure that is.

    Where none passes the best of all is reported without a node, so that one can see how far off it was.
    """
    if not len(matches):
        return Fix(None, np.inf, 0.0, np.zeros(3), None, np.inf, scope)
    order = np.lexsort((scores, ~passing))
    best, second = order[0], order[1] if len(order) > 1 else None
    return Fix(
        matches.nodes[best] if passing[best] else None,
        float(matches.distances[best]),
        float(matches.reachability[best]),
        matches.waypoints[best],
        None if second is None else matches.nodes[second],
        np.inf if second is None else float(scores[second] - scores[best]),
        scope,
    )


def around(graph: TopologicalGraph, plan: Sequence[NodeId]) -> tuple[NodeId, ...]:
    """Return the nodes of a plan and their neighbours, those still in the map."""
    nodes = dict.fromkeys(node for node in plan if node in graph.nodes)
    nodes |= dict.fromkeys(neighbour for node in plan for neighbour in graph.successors(node))
    return tuple(nodes)
