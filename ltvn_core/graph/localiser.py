"""Where am I: the node that looks nearest to the current image, first around the last plan, then in the whole map.

Owns the score and the gates. Does not own what happens when no node is near enough.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.config import LocalisingConfig
from ltvn_core.geometry import agree, distance, wrap_angle
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.place_belief import AT_PLACE, BelievedPlace
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, NodeId, Pose, Waypoint

LOCAL = "local"
GLOBAL = "global"
_MIN_REACHABILITY = 1e-6
_ASKED_AT_ONCE = 8
"""Number of nodes around a place that are compared in one call, the nearest first."""
_DOUBT_AT_PLACE, _DOUBT_ANYWHERE = 0.5, 1.5
"""Weights of -ln r, added to d: at a place, and where a view is shown beside all nodes."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationPrior:
    """State of the query that helps localisation."""

    plan: Sequence[NodeId] = ()
    """The nodes of the last plan."""
    doubted: Collection[NodeId] = ()
    """Nodes that the robot is no longer believed to be at."""
    place: BelievedPlace | None = None
    """The probable place given all observations; None without a place belief."""

    def candidates(self, graph: TopologicalGraph) -> tuple[NodeId, ...]:
        """Return all nodes that the robot may be at."""
        return tuple(node for node in graph.nodes if node not in self.doubted)


NO_PRIOR = LocalisationPrior()
"""The prior at the beginning of a query."""


class Localisation(NamedTuple):
    """The best node, and its certainty."""

    node: NodeId | None
    """None when no node is near enough."""
    distance: float
    """d of the best node, even if it is not near enough; infinite in an empty map."""
    reachability: float
    waypoint: Waypoint
    """(3,) pose of the best node in the robot's frame."""
    runner_up: NodeId | None
    margin: float
    """Score of the runner-up minus score of the best; infinite without a runner-up."""
    scope: str
    """Whether neighbours of the plan were searched (LOCAL) or the whole map (GLOBAL)."""
    probability: float | None = None
    """Probability of the place among all hypotheses; None without hypotheses."""


class Localiser:
    """Compares the current image with the map."""

    def __init__(self, matcher: Matcher, config: LocalisingConfig) -> None:
        """Localise with `matcher`."""
        self._matcher = matcher
        self._config = config

    def localise(
        self, features: Features, graph: TopologicalGraph, prior: LocalisationPrior = NO_PRIOR
    ) -> Localisation:
        """Return where the image (1, F) is: a neighbour of the last plan if one is near enough, else any node."""
        if prior.place is not None:
            return self._at_place(prior.place, features, prior)
        nearby = [node for node in plan_neighbourhood(graph, prior.plan) if node not in prior.doubted]
        if nearby:
            localisation = self._best_among(nearby, features, LOCAL)
            if localisation.node is not None:
                return localisation
        return self._best_among(prior.candidates(graph), features, GLOBAL)

    def _at_place(self, place: BelievedPlace, features: Features, prior: LocalisationPrior) -> Localisation:
        """Return the best of the nodes around a place, among those seen about where they are expected.

        The distances of the nodes are taken from the place, not from the image, because a corridor looks the same one
        metre farther on.
        """
        away = {node: float(distance(pose)) for node, pose in self._near_place(place, prior).items()}
        nodes = sorted(away, key=away.__getitem__)
        found, scores, passing = self._matcher.match(features, ()), np.empty(0), np.empty(0, bool)
        for start in range(0, len(nodes), _ASKED_AT_ONCE):
            second_best = np.partition(scores[passing], 1)[1] if np.count_nonzero(passing) > 1 else np.inf
            if away[nodes[start]] >= second_best:
                break  # No score is below the node's distance, so neither the best nor the runner-up can change.
            asked = self._where_expected(place, features, nodes[start : start + _ASKED_AT_ONCE])
            found = found.concatenated(asked)
            scores = np.array([away[node] for node in found.nodes]) + _DOUBT_AT_PLACE * doubt(found.reachability)
            passing = near_enough(found, self._config)
        best = best_localisation(found, scores, passing, LOCAL)
        return best._replace(probability=place.probability)

    def _near_place(self, place: BelievedPlace, prior: LocalisationPrior) -> dict[NodeId, Pose]:
        """Return the expected poses (3,) of the nodes that an image at a place can be near enough to."""
        most_m = self._config.distance + AT_PLACE[0]
        most_rad = self._config.distance / np.sqrt(2) + AT_PLACE[1]
        return {
            node: pose
            for node, pose in place.nodes.items()
            if node not in prior.doubted and np.hypot(pose[0], pose[1]) < most_m and abs(wrap_angle(pose[2])) < most_rad
        }

    def _where_expected(self, place: BelievedPlace, features: Features, nodes: Sequence[NodeId]) -> Matches:
        """Compare an image (1, F) with nodes; r is 0 where a node is not seen about where it is expected."""
        found = self._matcher.match(features, nodes)
        expected = np.array([place.nodes[node] for node in found.nodes])
        return found.with_reachability(found.reachability * agree(expected, found.waypoints, AT_PLACE))

    def _best_among(self, nodes: Sequence[NodeId], features: Features, scope: str) -> Localisation:
        matches = self._matcher.match(features, nodes)
        return best_localisation(matches, matches.distances, near_enough(matches, self._config), scope)

    def nearest_nodes(
        self, features: Features, graph: TopologicalGraph, count: int
    ) -> tuple[tuple[NodeId, float], ...]:
        """Return the `count` nodes that resemble an image (1, F) most, best first, with their reachability."""
        matches = self._matcher.match(features, tuple(graph.nodes))
        order = np.argsort(resemblance(matches), kind="stable")[:count]
        return tuple((matches.nodes[k], float(matches.reachability[k])) for k in order)


def resemblance(matches: Matches) -> NDArray[np.float64]:
    """Return (N,) d - 1.5 ln r, lowest for what a view resembles most; a node that is surely not seen comes last."""
    return matches.distances + _DOUBT_ANYWHERE * doubt(matches.reachability)


def near_enough(matches: Matches, config: LocalisingConfig) -> NDArray[np.bool_]:
    """Tell (N,) which matches are near enough to be where the robot is."""
    return (matches.distances < config.distance) & (matches.reachability > config.reachability)


def doubt(reachability: ArrayLike) -> NDArray[np.float64]:
    """Return -ln r for r of any shape, limited to finite values."""
    return np.asarray(-np.log(np.maximum(reachability, _MIN_REACHABILITY)), np.float64)


def best_localisation(
    matches: Matches, scores: NDArray[np.float64], passing: NDArray[np.bool_], scope: str
) -> Localisation:
    """Return the match with the lowest score (N,) among those that pass (N,), and its certainty.

    If none passes, the best match is reported without a node, so that a reader sees by how much it failed.
    """
    if not len(matches):
        return Localisation(None, np.inf, 0.0, np.zeros(3), None, np.inf, scope)
    order = np.lexsort((scores, ~passing))
    best = order[0]
    second = order[1] if len(order) > 1 else None
    # Without any waypoint both scores are infinite, and their difference is not a number.
    margin = np.inf if second is None or np.isinf(scores[best]) else float(scores[second] - scores[best])
    return Localisation(
        matches.nodes[best] if passing[best] else None,
        float(matches.distances[best]),
        float(matches.reachability[best]),
        matches.waypoints[best],
        None if second is None else matches.nodes[second],
        margin,
        scope,
    )


def plan_neighbourhood(graph: TopologicalGraph, plan: Sequence[NodeId]) -> tuple[NodeId, ...]:
    """Return the nodes of a plan and their neighbours that are still in the map."""
    nodes = dict.fromkeys(node for node in plan if node in graph.nodes)
    nodes |= dict.fromkeys(neighbour for node in plan for neighbour in graph.successors(node))
    return tuple(nodes)
