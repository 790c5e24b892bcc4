"""A long life on a large map, made up: what the debugger is measured with.

Owns the events. Nobody drove them; their numbers only have to be of the right kind and in the right proportion.
"""

from collections.abc import Iterator

import numpy as np

from benchmarks.planning import large_graph
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, EdgePruned, PoseRow
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation import events as e
from ltvn_core.types import CONTROL_STEP_S

EVENTS = 50_000
ATTEMPTS = 10
"""Per query."""
_STEPS_PER_EVENT = 3


def synthetic_run(count: int = EVENTS, seed: int = 0) -> list[e.StampedEvent]:
    """Return a map of 10,000 nodes and 50,000 edges that comes in, and about `count` events of queries on it."""
    rng = np.random.default_rng(seed)
    graph = large_graph(rng)
    loaded = [e.StampedEvent(0, 0.0, e.GraphChanged(delta)) for delta in graph.deltas()]
    driven = (event for query in range(count) for event in _query(query, graph, rng))
    moments = (_STEPS_PER_EVENT * number for number in range(1, count + 1))
    lived = [e.StampedEvent(step, CONTROL_STEP_S * step, event) for step, event in zip(moments, driven, strict=False)]
    return [*loaded, *lived]


def _query(query: int, graph: TopologicalGraph, rng: np.random.Generator) -> Iterator[e.Event]:
    """Yield a query of some legs, of which every third is a failure, with what the map learns from it."""
    nodes = tuple(int(node) for node in rng.choice(len(graph.nodes), ATTEMPTS + 1, replace=False))
    goal, collisions = nodes[-1], 0
    yield e.QueryStarted(query, goal)
    for number in range(ATTEMPTS):
        edge = _edge_from(graph, nodes[number])
        yield e.Localised(query, edge[0], edge[0], 0.3, 0.9, None, 0.2, "global")
        yield e.Planned(query, (edge[0], edge[1], goal), float(ATTEMPTS - number))
        yield from _attempt(query, query * ATTEMPTS + number, edge, graph, succeeded=number % 3 != 0)
        if number % 5 == 0:
            collisions += 1
            yield e.Collided(query, collisions)
    outcome = e.Outcome.ARRIVED if query % 4 else e.Outcome.STEP_LIMIT
    yield e.QueryEnded(query, goal, outcome, 200, collisions, 20.0)


def _attempt(query: int, attempt: int, edge: EdgeKey, graph: TopologicalGraph, *, succeeded: bool) -> Iterator[e.Event]:
    source, target = edge
    yield e.AttemptStarted(query, attempt, source, target, source, PoseRow(1.0, 0.0, 0.0), 0.9)
    end = e.AttemptEnd.REACHED if succeeded else e.AttemptEnd.TIMEOUT
    yield e.AttemptEnded(query, attempt, source, target, source, end, 0.4, 0.8, succeeded, "made up")
    delta = _evidence(attempt, edge, graph, succeeded=succeeded)
    graph.apply(delta)
    yield e.GraphChanged(delta, query, attempt)


def _evidence(attempt: int, edge: EdgeKey, graph: TopologicalGraph, *, succeeded: bool) -> BeliefUpdated | EdgePruned:
    """Return what a leg teaches: a new belief, and now and then that the edge is not there."""
    if attempt % 12 == 0:
        return EdgePruned(*edge, Cause.ATTEMPT)
    known = graph.edges[edge]
    p = known.belief.p + 0.1 * (succeeded - known.belief.p)
    belief = Belief(p, known.belief.mu, known.belief.sigma2)
    return BeliefUpdated(*edge, belief, known.attempts + 1, known.successes + succeeded, Cause.ATTEMPT)


def _edge_from(graph: TopologicalGraph, node: int) -> EdgeKey:
    """Return an edge of a node, or of the next one that has any."""
    while not graph.successors(node):
        node = (node + 1) % len(graph.nodes)
    return node, next(iter(graph.successors(node)))
