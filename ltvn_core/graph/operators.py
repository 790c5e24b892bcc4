"""What changes the map, as pure functions: the paper's two operators and its updates after driving.

Owns the decisions about one image against the nodes, isMergeable and isConnectable, which building, driving and
expansion use with their own thresholds; the deltas that tie an image into the map; and the two Bayes filters of an
edge, Eq. 3 for its existence and Eq. 4 for its length, with pruning and novel nodes. Changes no graph. Does not judge
attempts (`navigation.learning`) nor search for new paths (`graph.ltvn`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BeliefConfig, BuildingConfig, Method
from ltvn_core.geometry import invert
from ltvn_core.graph import deltas as d
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.presence.obstruction import Obstruction
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, FrameId, NodeId, Observation, Waypoint

_MERGE_CANDIDATES = 3
_MERGE_REACHABILITY = 0.6
"""Least r for merging; the paper has none."""
_NOVEL_CONNECT, _NOVEL_MERGE = 1.3, 0.6
"""Factors on D_c and D_m for novel nodes: the paper makes the first looser and the second smaller."""


def novel_thresholds(building: BuildingConfig) -> BuildingConfig:
    """Return the thresholds for novel nodes: D_c looser, D_m smaller."""
    return replace(
        building,
        merge_distance=building.merge_distance * _NOVEL_MERGE,
        connect_distance=building.connect_distance * _NOVEL_CONNECT,
    )


def mergeable(matches: Matches, thresholds: BuildingConfig) -> NDArray[np.bool_]:
    """Tell for each node (N,) whether the image merges with it: d < D_m."""
    return (matches.distances < thresholds.merge_distance) & (matches.reachability > _MERGE_REACHABILITY)


def connectable(matches: Matches, thresholds: BuildingConfig) -> NDArray[np.bool_]:
    """Tell for each node (N,) whether an edge may join it to the image: d < D_c and r > R_c."""
    return (matches.distances < thresholds.connect_distance) & (matches.reachability > thresholds.connect_reachability)


def nearest_mergeable(frame: FrameId, found: Matches, matcher: Matcher, thresholds: BuildingConfig) -> Matches | None:
    """Return the match of the node that a stored frame merges with, the nearest one; None if there is none."""
    alike = found.take(mergeable(found, thresholds))
    # One by one, because temporal support is expensive and the nearest node nearly always has it.
    for k in np.argsort(alike.distances, kind="stable")[:_MERGE_CANDIDATES]:
        nearest = matcher.with_mutual_support(alike.take(np.array([k])), frame)
        if mergeable(nearest, thresholds).any():
            return nearest
    return None


def initial_belief(reachability: float, distance: float, config: BeliefConfig) -> d.Belief:
    """Return the belief of a new edge: p0 = r capped, mu0 = d(w), sigma0^2 = sigma^2."""
    return d.Belief(min(float(reachability), config.p_cap), float(distance), config.sigma2)


def node_from_observation(observation: Observation) -> d.Node:
    """Return the node that an image becomes."""
    return d.Node(observation.step, pose_row(observation.odometry))


def pose_row(pose: Waypoint) -> d.PoseRow:
    """Return a pose (3,) as plain numbers."""
    return d.PoseRow(*(float(value) for value in pose))


def node_with_edges(
    observation: Observation, matches: Matches, config: BeliefConfig, cause: d.Cause, *, by_odometry: bool = False
) -> Sequence[d.NodeAdded | d.EdgeAdded]:
    """Return the deltas that make an image a node and join it both ways to every match."""
    return [
        d.NodeAdded(node_from_observation(observation), cause),
        *bidirectional_edges(observation.step, matches, config, cause, by_odometry=by_odometry),
    ]


def bidirectional_edges(
    source: NodeId, matches: Matches, config: BeliefConfig, cause: d.Cause, *, by_odometry: bool = False
) -> Iterable[d.EdgeAdded]:
    """Yield an edge to each match and the reverse edge, whose waypoint is the inverse.

    `by_odometry` marks edges that only odometry supports.
    """
    for k, target in enumerate(matches.nodes):
        belief = initial_belief(matches.reachability[k], matches.distances[k], config)
        ahead = pose_row(matches.waypoints[k])
        back = pose_row(invert(matches.waypoints[k]))
        yield d.EdgeAdded(d.Edge(source, target, ahead, belief, by_odometry=by_odometry), cause)
        yield d.EdgeAdded(d.Edge(target, source, back, belief, by_odometry=by_odometry), cause)


HINDERED_PRUNE_BELOW = 0.05
"""R_p of failures with an obstacle in the way, if these count less; low, so that many of them are needed."""


@dataclass(frozen=True, slots=True)
class AttemptEvidence:
    """Evidence from one attempt to drive an edge."""

    source: NodeId
    target: NodeId
    distance: float
    """d(w_aj) measured at departure from the real view o_a."""
    succeeded: bool
    failed_before: bool = False
    """Whether the edge failed earlier in this query."""
    hindered: bool = False
    """Whether the attempt failed for a reason that says little about the edge: an obstacle, driving in circles, or a
    target that is hard to recognise where odometry expects it."""
    stamp: float = 0.0
    """End of the attempt, in seconds on the clock of the world."""
    obstruction: Obstruction | None = None
    """New obstacles around the way, which were not there when the map was made."""


def update_existence(p: float, config: BeliefConfig, *, succeeded: bool, weight: float = 1.0) -> float:
    """Return p after one attempt, Eq. 3.

    p' = p(s|r) p / (p(s|r) p + p(s|not r) (1 - p)), with 1 - p(s|.) in place of p(s|.) after a failure. The cap keeps p
    below 1 after many successes, so that later failures can still prune the edge. `weight` is the share of a full
    attempt that this one counts for (ours).
    """
    if_there = (config.p_success_if_reachable if succeeded else 1 - config.p_success_if_reachable) ** weight
    if_not = (config.p_success_if_not if succeeded else 1 - config.p_success_if_not) ** weight
    evidence = if_there * p + if_not * (1 - p)
    return min(if_there * p / evidence, config.p_cap) if evidence > 0 else p


def update_length(belief: d.Belief, measured: float, config: BeliefConfig) -> tuple[float, float]:
    """Return (mu, sigma2) after d was measured once more, Eq. 4.

    mu' = (sigma^2 mu + sigma_t^2 d) / (sigma_t^2 + sigma^2) and 1 / sigma'^2 = 1 / sigma_t^2 + 1 / sigma^2. Beginning
    with sigma_0^2 = sigma^2 this is the running mean of all n measurements with variance sigma^2 / n.
    """
    total = belief.sigma2 + config.sigma2
    mu = (config.sigma2 * belief.mu + belief.sigma2 * measured) / total
    return mu, belief.sigma2 * config.sigma2 / total


def update_belief(
    belief: d.Belief, measured: float, config: BeliefConfig, *, succeeded: bool, weight: float = 1.0
) -> d.Belief:
    """Return the belief after an attempt: Eq. 3 always, Eq. 4 only after a success."""
    p = update_existence(belief.p, config, succeeded=succeeded, weight=weight)
    mu, sigma2 = update_length(belief, measured, config) if succeeded else (belief.mu, belief.sigma2)
    return d.Belief(p, mu, sigma2)


def update_edge(graph: TopologicalGraph, attempt: AttemptEvidence, config: BeliefConfig) -> tuple[d.GraphDelta, ...]:
    """Return the new belief of the driven edge, Eq. 3 and Eq. 4, and its pruning after too many failures.

    Nothing changes if the edge is no longer in the map. If the failures of one query count once, a second failure in
    that query changes nothing either.
    """
    edge = graph.edges.get((attempt.source, attempt.target))
    if edge is None or (attempt.failed_before and not attempt.succeeded and config.one_failure_per_query):
        return ()
    weight = config.hindered_weight if attempt.hindered and not attempt.succeeded else 1.0
    belief = update_belief(edge.belief, attempt.distance, config, succeeded=attempt.succeeded, weight=weight)
    attempts = edge.attempts + 1
    successes = edge.successes + attempt.succeeded
    updated = d.BeliefUpdated(edge.source, edge.target, belief, attempts, successes, d.Cause.ATTEMPT)
    counts_less = attempt.hindered and config.hindered_weight < 1
    least_p = min(config.prune_below, HINDERED_PRUNE_BELOW) if counts_less else config.prune_below
    after = replace(edge, belief=belief, attempts=attempts, successes=successes)
    if attempt.succeeded or not should_prune(after, least_p, config):
        return (updated,)
    return updated, d.EdgePruned(edge.source, edge.target, d.Cause.ATTEMPT)


def should_prune(edge: d.Edge, least_p: float, config: BeliefConfig) -> bool:
    """Tell whether an edge is to be pruned after a failure: p below `least_p`, failed often enough, not protected."""
    failures = edge.attempts - edge.successes
    enough = config.prune_after_failures + config.failures_per_success * edge.successes
    return edge.belief.p < least_p and failures >= enough and not edge.protected


def novel_node(
    graph: TopologicalGraph, observation: Observation, features: Features, matcher: Matcher, method: Method
) -> tuple[d.GraphDelta, ...]:
    """Return the deltas that make an unrecognised image, with features (1, F), a node; none if it merges or no edge
    joins it to the map.

    D_c is looser and D_m smaller than in building.
    """
    thresholds = novel_thresholds(method.building)
    if observation.step in graph.nodes or observation.step in graph.reserve:
        return ()
    matches = matcher.match(features, tuple(graph.nodes))
    if mergeable(matches, thresholds).any():
        return ()
    chosen = matches.take(connectable(matches, thresholds))
    if method.expanding.strict:
        chosen = matcher.with_node_support(chosen, features)
        chosen = chosen.take(connectable(chosen, thresholds))
    # A node without an edge could never be used, so it is not added.
    return tuple(node_with_edges(observation, chosen, method.believing, d.Cause.NOVEL)) if len(chosen) else ()
