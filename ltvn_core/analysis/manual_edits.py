"""Manual changes of a map's edges, as deltas with the cause `hand`, and the deltas that undo them.

Owns the possible changes and how each is undone. The owner of the map applies the deltas.
"""

import math

from ltvn_core.config import BeliefConfig
from ltvn_core.errors import MapError, OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import (
    MAX_ACTION_LENGTH,
    EdgeKey,
    TopologicalGraph,
    is_action,
    presence_deltas,
)
from ltvn_core.types import NodeId


def remove_edge(graph: TopologicalGraph, source: NodeId, target: NodeId) -> d.EdgePruned:
    """Return the delta that removes an edge, even a protected one. Raises MapError if there is none."""
    _edge(graph, (source, target))
    return d.EdgePruned(source, target, d.Cause.HAND)


def protect_edge(graph: TopologicalGraph, source: NodeId, target: NodeId, *, protected: bool = True) -> d.EdgeProtected:
    """Return the delta that keeps maintenance from pruning an edge, or allows it again.

    Raises MapError if there is no such edge.
    """
    _edge(graph, (source, target))
    return d.EdgeProtected(source, target, protected=protected, cause=d.Cause.HAND)


def connect_by_action(
    graph: TopologicalGraph, source: NodeId, target: NodeId, action: str, mu: float = 10.0
) -> tuple[d.GraphDelta, ...]:
    """Return the deltas that join two nodes by an action, such as "Take the lift to floor 2", in this direction only.

    `mu` is the cost of the action in a plan, in metres of driving; an existing edge keeps its own. Raises MapError if a
    node is missing, OptionError for an invalid action or cost.
    """
    for node in (source, target):
        if node not in graph.nodes:
            raise MapError(f"Node {node} is not in the map, which has {len(graph.nodes)} nodes.")
    wanted = " ".join(action.split())
    if not wanted or not is_action(wanted):
        raise OptionError(
            f"{wanted[:MAX_ACTION_LENGTH]!r} cannot be an action: use 1 to {MAX_ACTION_LENGTH} printable characters."
        )
    if (source, target) in graph.edges:
        return protect_edge(graph, source, target), d.EdgeActionSet(source, target, wanted, d.Cause.HAND)
    if source == target:
        raise MapError(f"Edge {source} -> {target} cannot be added: a node has no edge to itself.")
    if not 0 <= mu < math.inf:
        raise OptionError(f"An action cannot cost {mu} m; give 0 or more.")
    config = BeliefConfig()
    belief = d.Belief(config.p_cap, mu, config.sigma2)
    edge = d.Edge(source, target, d.PoseRow(0.0, 0.0, 0.0), belief, protected=True, action=wanted)
    return (d.EdgeAdded(edge, d.Cause.HAND),)


def inverse_deltas(delta: d.GraphDelta, graph_before: TopologicalGraph) -> tuple[d.GraphDelta, ...]:
    """Return the deltas, with the cause `hand`, that undo a manual change of an edge; none for other changes.

    `graph_before` is the map before that delta. Raises MapError if the delta did not fit the map.
    """
    match delta:
        case d.EdgeAdded(edge):
            return (d.EdgePruned(edge.source, edge.target, d.Cause.HAND),)
        case d.EdgePruned(source, target):
            key = source, target
            presence = {key: graph_before.presence[key]} if key in graph_before.presence else {}
            back = d.EdgeAdded(_edge(graph_before, key), d.Cause.HAND)
            return (back, *presence_deltas(presence, d.Cause.HAND))
        case d.EdgeProtected(source, target):
            held = _edge(graph_before, (source, target)).protected
            return (d.EdgeProtected(source, target, held, d.Cause.HAND),)
        case d.EdgeActionSet(source, target):
            return (d.EdgeActionSet(source, target, _edge(graph_before, (source, target)).action, d.Cause.HAND),)
        case _:
            return ()


def _edge(graph: TopologicalGraph, key: EdgeKey) -> d.Edge:
    if key not in graph.edges:
        raise MapError(f"Edge {key[0]} -> {key[1]} is not in the map, which has {len(graph.edges)} edges.")
    return graph.edges[key]
