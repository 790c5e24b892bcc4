"""What driving does to the map, as pure functions (graph, evidence) -> deltas.

Owns the updates after an attempt, pruning, and novel nodes. Does not judge an attempt (`nav.judgement`) nor search for
new paths (`graph.expansion`).
"""

from dataclasses import dataclass, replace

from ltvn_core.config import Believing, Method
from ltvn_core.graph.beliefs import after_attempt
from ltvn_core.graph.closures import Stretch
from ltvn_core.graph.deltas import BeliefUpdated, Cause, Edge, EdgePruned, GraphDelta
from ltvn_core.graph.localizer import fit_the_way
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import Gates, connectable, mergeable, node_with_edges
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.types import Features, NodeId, Observation


@dataclass(frozen=True, slots=True)
class Attempt:
    """An edge was driven."""

    source: NodeId
    target: NodeId
    distance: float
    """d(w_aj) measured at departure from the real view o_a."""
    succeeded: bool
    failed_before: bool = False
    """The edge failed in this query already."""
    hindered: bool = False
    """It failed because something stood in the way, the robot went in circles or the target was hard to recognise
    where odometry expected it: that says little of the edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Lost:
    """No node is near enough to the current image, or none that fits to the way here."""

    observation: Observation
    image: Features
    """(1, F) of the observation."""
    looks_in_vain: int
    """Looks in a row, this one included, that found no node or no path."""
    trail: Stretch | None = None
    """What was seen on the way here."""


def update_edge(graph: TopologicalGraph, attempt: Attempt, config: Believing) -> tuple[GraphDelta, ...]:
    """Return the new belief of the driven edge, Eq. 3 and Eq. 4, and its pruning if it has failed too often.

    Nothing changes for an edge that has left the map meanwhile, nor for a second failure in one query where
    failures of one query count as one.
    """
    edge = graph.edges.get((attempt.source, attempt.target))
    if edge is None or (attempt.failed_before and not attempt.succeeded and config.one_failure_per_query):
        return ()
    weight = config.hindered_weight if attempt.hindered and not attempt.succeeded else 1.0
    belief = after_attempt(edge.belief, attempt.distance, config, succeeded=attempt.succeeded, weight=weight)
    attempts, successes = edge.attempts + 1, edge.successes + attempt.succeeded
    updated = BeliefUpdated(edge.source, edge.target, belief, attempts, successes, Cause.ATTEMPT)
    least_p = config.hindered_prune_below if attempt.hindered else config.prune_below
    after = replace(edge, belief=belief, attempts=attempts, successes=successes)
    if attempt.succeeded or not is_hopeless(after, least_p, config):
        return (updated,)
    return updated, EdgePruned(edge.source, edge.target, Cause.ATTEMPT)


def is_hopeless(edge: Edge, least_p: float, config: Believing) -> bool:
    """Tell whether an edge is to be pruned after a failure: p below `least_p`, failed often enough, not protected."""
    failures = edge.attempts - edge.successes
    enough = config.prune_after_failures + config.failures_per_success * edge.successes
    return edge.belief.p < least_p and failures >= enough and not edge.protected


def novel_node(graph: TopologicalGraph, lost: Lost, matcher: Matcher, method: Method) -> tuple[GraphDelta, ...]:
    """Return the deltas that make an image nobody recognised a node; none if it merges or touches nothing.

    D_c is looser and D_m smaller than in building. What must not be where the robot is, after all that it saw on its
    way, is not tied to it either.
    """
    gates, observation = Gates.building(method.building).for_novel(method.expanding), lost.observation
    if observation.step in graph.nodes or observation.step in graph.reserve:
        return ()
    matches = matcher.match(lost.image, tuple(graph.nodes))
    if mergeable(matches, gates).any():
        return ()
    chosen = matches.take(connectable(matches, gates))
    if method.expanding.strict:
        chosen = matcher.witnessed(chosen, lost.image)
        chosen = chosen.take(connectable(chosen, gates) & fit_the_way(matcher, lost.trail, chosen, method.localising))
    # A node without an edge could never be used, so it waits until it touches something.
    return tuple(node_with_edges(observation, chosen, method.believing, Cause.NOVEL)) if len(chosen) else ()
