"""Manual changes of a map, as deltas with the cause `hand`, and the deltas that undo any change.

Owns the possible changes and how each is undone. The owner of the map applies the deltas.
"""

import math
from collections.abc import Sequence
from typing import assert_never

import numpy as np

from ltvn_core.config import BeliefConfig
from ltvn_core.errors import MapError, OptionError
from ltvn_core.geometry import distance, relative
from ltvn_core.graph import deltas as d
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import (
    MAX_ACTION_LENGTH,
    EdgeKey,
    TopologicalGraph,
    is_action,
    presence_deltas,
)
from ltvn_core.types import NodeId, Waypoint

MAX_NAME_LENGTH = 60
"""Greatest length of a node's name, in characters."""
_MAX_EDGE_DISTANCE = 5.0
"""Greatest d of a new edge; over a longer distance, the image of the target does not guide the robot."""


def add_edge(
    graph: TopologicalGraph,
    source: NodeId,
    target: NodeId,
    config: BeliefConfig,
    *,
    waypoint: Waypoint | None = None,
) -> d.EdgeAdded:
    """Return the delta that joins two nodes, with the highest p that the method allows.

    `waypoint` (3,), metres and radians, is the pose of the target in the source's frame, such as the network's
    prediction; by default it comes from odometry. Raises MapError if a node is missing or the edge exists, OptionError
    if the ends are too far apart.
    """
    _require_nodes(graph, source, target)
    if source == target or (source, target) in graph.edges:
        raise MapError(f"Edge {source} -> {target} cannot be added: {_why_not(source, target)}.")
    way = waypoint if waypoint is not None else relative(*(np.array(graph.nodes[k].odometry) for k in (source, target)))
    length = float(distance(way))
    if not length <= _MAX_EDGE_DISTANCE:
        raise OptionError(
            f"Edge {source} -> {target} would be {length:.1f} long; an edge joins places in sight of each other, at "
            f"most {_MAX_EDGE_DISTANCE:g} apart. Choose nearer nodes or join them through others."
        )
    belief = d.Belief(config.p_cap, length, config.sigma2)
    return d.EdgeAdded(d.Edge(source, target, pose_row(way), belief), d.Cause.HAND)


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
    _require_nodes(graph, source, target)
    wanted = " ".join(action.split())
    if not wanted or not is_action(wanted):
        raise OptionError(
            f"{wanted[:MAX_ACTION_LENGTH]!r} cannot be an action: use 1 to {MAX_ACTION_LENGTH} printable characters."
        )
    if (source, target) in graph.edges:
        return protect_edge(graph, source, target), d.EdgeActionSet(source, target, wanted, d.Cause.HAND)
    if source == target:
        raise MapError(f"Edge {source} -> {target} cannot be added: {_why_not(source, target)}.")
    if not 0 <= mu < math.inf:
        raise OptionError(f"An action cannot cost {mu} m; give 0 or more.")
    config = BeliefConfig()
    belief = d.Belief(config.p_cap, mu, config.sigma2)
    edge = d.Edge(source, target, d.PoseRow(0.0, 0.0, 0.0), belief, protected=True, action=wanted)
    return (d.EdgeAdded(edge, d.Cause.HAND),)


def delete_node(graph: TopologicalGraph, node: NodeId) -> d.NodeDropped:
    """Return the delta that removes a node and its edges. Its image does not join the reserve, because maintenance
    would then add it again. Raises MapError if there is no such node."""
    _require_nodes(graph, node)
    return d.NodeDropped(node, d.Cause.HAND)


def rename_node(graph: TopologicalGraph, node: NodeId, name: str) -> d.NodeNamed:
    """Return the delta that names a node; an empty name removes its name.

    Raises MapError for a missing node or a name in use, OptionError for an invalid name.
    """
    _require_nodes(graph, node)
    return d.NodeNamed(node, _free_name(graph, node, name), goal=graph.nodes[node].goal, cause=d.Cause.HAND)


def mark_goal(graph: TopologicalGraph, node: NodeId, name: str = "", *, goal: bool = True) -> d.NodeNamed:
    """Return the delta that marks a node as a goal with a name, or removes the mark; an empty name keeps the old one.

    Raises as `rename_node` does.
    """
    _require_nodes(graph, node)
    named = _free_name(graph, node, name) or graph.nodes[node].name
    return d.NodeNamed(node, named, goal=goal, cause=d.Cause.HAND)


def inverse_deltas(delta: d.GraphDelta, graph_before: TopologicalGraph) -> tuple[d.GraphDelta, ...]:
    """Return the deltas, with the cause `hand`, that undo one delta; `graph_before` is the map before that delta.

    Linear in the edges of a dropped node, constant otherwise. Raises MapError if the delta did not fit the map.
    """
    match delta:
        case d.NodeAdded(node):
            return (d.NodeDropped(node.id, d.Cause.HAND),)
        case d.NodeDropped(node):
            return _node_with_edges(graph_before, node)
        case d.EdgeAdded(edge):
            return (d.EdgePruned(edge.source, edge.target, d.Cause.HAND),)
        case d.EdgePruned(source, target):
            return _edges_back(graph_before, [(source, target)])
        case d.BeliefUpdated(source, target):
            return (_belief_of(_edge(graph_before, (source, target))),)
        case d.EdgeProtected(source, target):
            held = _edge(graph_before, (source, target)).protected
            return (d.EdgeProtected(source, target, held, d.Cause.HAND),)
        case d.EdgeActionSet(source, target):
            return (d.EdgeActionSet(source, target, _edge(graph_before, (source, target)).action, d.Cause.HAND),)
        case d.PresenceObserved(source, target):
            # An observation alone cannot be removed, so the edge is removed and added again with its earlier
            # observations.
            back = _edges_back(graph_before, [(source, target)])
            return (d.EdgePruned(source, target, d.Cause.HAND), *back)
        case d.NodeNamed(node):
            _require_nodes(graph_before, node)
            before = graph_before.nodes[node]
            return (d.NodeNamed(node, before.name, before.goal, d.Cause.HAND),)
        case d.DriveBegun():
            return ()  # The beginning of a drive cannot be edited.
        case d.FramesReserved(frames):
            return (d.FramesReleased(frames, d.Cause.HAND),)
        case d.FramesReleased(frames):
            return (d.FramesReserved(tuple(dict.fromkeys(frames)), d.Cause.HAND),)
    assert_never(delta)


def _node_with_edges(graph: TopologicalGraph, node: NodeId) -> tuple[d.GraphDelta, ...]:
    _require_nodes(graph, node)
    keys = [(node, other) for other in graph.successors(node)]
    keys += [(other, node) for other in graph.predecessors(node)]
    return (d.NodeAdded(graph.nodes[node], d.Cause.HAND), *_edges_back(graph, keys))


def _edges_back(graph: TopologicalGraph, keys: Sequence[EdgeKey]) -> tuple[d.GraphDelta, ...]:
    """Return the deltas that add edges again, with the observations of their presence."""
    edges = [d.EdgeAdded(_edge(graph, key), d.Cause.HAND) for key in keys]
    presence = {key: graph.presence[key] for key in keys if key in graph.presence}
    return (*edges, *presence_deltas(presence, d.Cause.HAND))


def _belief_of(edge: d.Edge) -> d.BeliefUpdated:
    return d.BeliefUpdated(
        source=edge.source,
        target=edge.target,
        belief=edge.belief,
        attempts=edge.attempts,
        successes=edge.successes,
        cause=d.Cause.HAND,
    )


def _edge(graph: TopologicalGraph, key: EdgeKey) -> d.Edge:
    if key not in graph.edges:
        raise MapError(f"Edge {key[0]} -> {key[1]} is not in the map, which has {len(graph.edges)} edges.")
    return graph.edges[key]


def _require_nodes(graph: TopologicalGraph, *nodes: NodeId) -> None:
    for node in nodes:
        if node not in graph.nodes:
            raise MapError(f"Node {node} is not in the map, which has {len(graph.nodes)} nodes.")


def _why_not(source: NodeId, target: NodeId) -> str:
    return "a node has no edge to itself" if source == target else "it is in the map already"


def _free_name(graph: TopologicalGraph, node: NodeId, name: str) -> str:
    wanted = " ".join(name.split())
    if len(wanted) > MAX_NAME_LENGTH or not wanted.isprintable():
        raise OptionError(
            f"{wanted[:MAX_NAME_LENGTH]!r} cannot be a name: use at most {MAX_NAME_LENGTH} printable characters."
        )
    holder = graph.names.get(wanted, node)
    if holder != node:
        raise MapError(f"Node {holder} is called {wanted!r} already; rename that one first or choose another name.")
    return wanted
