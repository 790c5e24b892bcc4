"""Changes of the map after driving, as pure functions (graph, evidence) -> deltas.

Owns the two Bayes filters of an edge, Eq. 3 for its existence and Eq. 4 for its length, pruning, and novel nodes. Does
not judge an attempt (`navigation.learning`) nor search for new paths (`graph.ltvn`).
"""

from dataclasses import dataclass, replace

from ltvn_core.config import BeliefConfig, Method
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgePruned, GraphDelta
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import OperatorThresholds, connectable, mergeable, node_with_edges
from ltvn_core.graph.presence.obstruction import Obstruction
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, NodeId, Observation

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


def update_length(belief: Belief, measured: float, config: BeliefConfig) -> tuple[float, float]:
    """Return (mu, sigma2) after d was measured once more, Eq. 4.

    mu' = (sigma^2 mu + sigma_t^2 d) / (sigma_t^2 + sigma^2) and 1 / sigma'^2 = 1 / sigma_t^2 + 1 / sigma^2. Beginning
    with sigma_0^2 = sigma^2 this is the running mean of all n measurements with variance sigma^2 / n.
    """
    total = belief.sigma2 + config.sigma2
    mu = (config.sigma2 * belief.mu + belief.sigma2 * measured) / total
    return mu, belief.sigma2 * config.sigma2 / total


def update_belief(
    belief: Belief, measured: float, config: BeliefConfig, *, succeeded: bool, weight: float = 1.0
) -> Belief:
    """Return the belief after an attempt: Eq. 3 always, Eq. 4 only after a success."""
    p = update_existence(belief.p, config, succeeded=succeeded, weight=weight)
    mu, sigma2 = update_length(belief, measured, config) if succeeded else (belief.mu, belief.sigma2)
    return Belief(p, mu, sigma2)


def update_edge(graph: TopologicalGraph, attempt: AttemptEvidence, config: BeliefConfig) -> tuple[GraphDelta, ...]:
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
    updated = BeliefUpdated(edge.source, edge.target, belief, attempts, successes, Cause.ATTEMPT)
    counts_less = attempt.hindered and config.hindered_weight < 1
    least_p = min(config.prune_below, HINDERED_PRUNE_BELOW) if counts_less else config.prune_below
    after = replace(edge, belief=belief, attempts=attempts, successes=successes)
    if attempt.succeeded or not should_prune(after, least_p, config):
        return (updated,)
    return updated, EdgePruned(edge.source, edge.target, Cause.ATTEMPT)


def should_prune(edge: Edge, least_p: float, config: BeliefConfig) -> bool:
    """Tell whether an edge is to be pruned after a failure: p below `least_p`, failed often enough, not protected."""
    failures = edge.attempts - edge.successes
    enough = config.prune_after_failures + config.failures_per_success * edge.successes
    return edge.belief.p < least_p and failures >= enough and not edge.protected


def novel_node(
    graph: TopologicalGraph, observation: Observation, features: Features, matcher: Matcher, method: Method
) -> tuple[GraphDelta, ...]:
    """Return the deltas that make an unrecognised image, with features (1, F), a node; none if it merges or no edge
    joins it to the map.

    D_c is looser and D_m smaller than in building.
    """
    thresholds = OperatorThresholds.building(method.building).for_novel_nodes()
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
    return tuple(node_with_edges(observation, chosen, method.believing, Cause.NOVEL)) if len(chosen) else ()
