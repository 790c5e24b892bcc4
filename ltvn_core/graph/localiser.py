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


def localise(
    features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher, *, config: LocalisingConfig
) -> Localisation:
    """Return where the image (1, F) is: a neighbour of the last plan if one is near enough, else any node."""
    if prior.place is not None:
        return _at_place(prior.place, features, prior, matcher, config)

    def best_among(nodes: Sequence[NodeId], scope: str) -> Localisation:
        found = matcher.match(features, nodes)
        return best_localisation(found, found.distances, near_enough(found, config), scope)

    nearby = [node for node in plan_neighbourhood(graph, prior.plan) if node not in prior.doubted]
    local = best_among(nearby, LOCAL) if nearby else None
    return local if local is not None and local.node is not None else best_among(prior.candidates(graph), GLOBAL)


def _at_place(
    place: BelievedPlace, features: Features, prior: LocalisationPrior, matcher: Matcher, config: LocalisingConfig
) -> Localisation:
    """Return the best of the nodes around a place, among those seen about where they are expected.

    The distances of the nodes are taken from the place, not from the image, because a corridor looks the same one metre
    farther on.
    """
    away = {node: float(distance(pose)) for node, pose in _near_place(place, prior, config).items()}
    nodes = sorted(away, key=away.__getitem__)
    found, scores, passing = matcher.match(features, ()), np.empty(0), np.empty(0, bool)
    for start in range(0, len(nodes), _ASKED_AT_ONCE):
        second_best = np.partition(scores[passing], 1)[1] if np.count_nonzero(passing) > 1 else np.inf
        if away[nodes[start]] >= second_best:
            break  # No score is below the node's distance, so neither the best nor the runner-up can change.
        asked = matcher.match(features, nodes[start : start + _ASKED_AT_ONCE])
        expected = np.array([place.nodes[node] for node in asked.nodes])
        seen_there = asked.reachability * agree(expected, asked.waypoints, AT_PLACE)
        found = found.concatenated(asked.with_reachability(seen_there))
        scores = np.array([away[node] for node in found.nodes]) + _DOUBT_AT_PLACE * doubt(found.reachability)
        passing = near_enough(found, config)
    return best_localisation(found, scores, passing, LOCAL)._replace(probability=place.probability)


def _near_place(place: BelievedPlace, prior: LocalisationPrior, config: LocalisingConfig) -> dict[NodeId, Pose]:
    """Return the expected poses (3,) of the nodes that an image at a place can be near enough to."""
    most_m = config.distance + AT_PLACE[0]
    most_rad = config.distance / np.sqrt(2) + AT_PLACE[1]
    return {
        node: pose
        for node, pose in place.nodes.items()
        if node not in prior.doubted and np.hypot(pose[0], pose[1]) < most_m and abs(wrap_angle(pose[2])) < most_rad
    }


def nearest_nodes(
    features: Features, graph: TopologicalGraph, count: int, matcher: Matcher
) -> tuple[tuple[NodeId, float], ...]:
    """Return the `count` nodes that resemble an image (1, F) most, best first, with their reachability."""
    matches = matcher.match(features, tuple(graph.nodes))
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
