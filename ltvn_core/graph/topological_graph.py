"""The map: nodes, directed edges with beliefs, and the reserve T'. Changed only by `apply`.

Owns the structure and its invariants: an edge joins two different nodes that are there, a frame is a node or in the
reserve but never both, and a name belongs to one node. Does not own images or features
(`graph.keyframes`) nor decisions (`graph.builder`, `graph.operators`).
"""

import math
from bisect import bisect_right
from collections.abc import Iterable, KeysView, Mapping
from copy import copy
from dataclasses import replace
from types import MappingProxyType
from typing import Self, TypeAlias, assert_never

from ltvn_core.errors import MapError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.presence.presence_filter import PresenceObservation
from ltvn_core.types import FrameId, NodeId


def check_edge(edge: d.Edge) -> None:
    """Raise MapError for an invalid edge; the message is only formatted then, because maps are folded from many
    edges."""
    belief: d.Belief = edge.belief
    counts = 0 <= edge.successes <= edge.attempts
    fits = 0 <= belief.p <= 1 and 0 <= belief.mu < math.inf and 0 < belief.sigma2 < math.inf
    if counts and fits and is_action(edge.action):
        return
    name = edge_name(edge)
    require(0 <= belief.p <= 1, f"{name} has p = {belief.p}; it must lie in [0, 1].")
    require(0 <= belief.mu < math.inf, f"{name} has mu = {belief.mu}; it must be finite and not negative.")
    require(0 < belief.sigma2 < math.inf, f"{name} has sigma2 = {belief.sigma2}; it must be positive.")
    require(counts, f"{name} counts {edge.successes} successes in {edge.attempts} attempts.")
    raise MapError(
        f"{name} cannot have the action {edge.action[:MAX_ACTION_LENGTH]!r}: use one line of at most "
        f"{MAX_ACTION_LENGTH} printable characters."
    )


def edge_name(edge: d.Edge) -> str:
    """Name an edge in an error."""
    return f"Edge {edge.source} -> {edge.target}"


def require(holds: bool, otherwise: str) -> None:
    """Raise MapError with the message `otherwise` unless a condition holds."""
    if not holds:
        raise MapError(otherwise)


EdgeKey: TypeAlias = tuple[NodeId, NodeId]
"""Source and target, which name an edge."""

MAX_ACTION_LENGTH = 200
"""Largest number of characters of an edge's action."""
MOST_PRESENCE_OBSERVATIONS = 256
"""Number of latest observations of presence kept for an edge."""


class TopologicalGraph:
    """A directed graph of places that only deltas change; two graphs are equal if their contents are."""

    def __init__(self, deltas: Iterable[d.GraphDelta] = ()) -> None:
        """Fold `deltas`, in order, into a graph; raise MapError at the first that does not fit."""
        self._nodes: dict[NodeId, d.Node] = {}
        self._edges: dict[EdgeKey, d.Edge] = {}
        self._presence: dict[EdgeKey, tuple[PresenceObservation, ...]] = {}
        self._reserve: dict[FrameId, None] = {}
        self._drives: dict[FrameId, str] = {}
        self._names: dict[str, NodeId] = {}
        self._successors: dict[NodeId, dict[NodeId, None]] = {}
        self._predecessors: dict[NodeId, dict[NodeId, None]] = {}
        self.version = 0
        """Number of deltas applied; a cache is stale if this differs."""
        for delta in deltas:
            self.apply(delta)

    @property
    def nodes(self) -> Mapping[NodeId, d.Node]:
        """All nodes by id, oldest first; read only."""
        return MappingProxyType(self._nodes)

    @property
    def edges(self) -> Mapping[EdgeKey, d.Edge]:
        """All edges by (source, target), oldest first; read only."""
        return MappingProxyType(self._edges)

    @property
    def driven_edges(self) -> Mapping[EdgeKey, d.Edge]:
        """The edges without an action, whose waypoints tell where their targets are; linear in edges."""
        return {key: edge for key, edge in self._edges.items() if not edge.action}

    @property
    def presence(self) -> Mapping[EdgeKey, tuple[PresenceObservation, ...]]:
        """Observations of edges that were blocked at some time, oldest first; read only."""
        return MappingProxyType(self._presence)

    @property
    def frames(self) -> tuple[FrameId, ...]:
        """All images that the map needs: those of nodes and of the reserve."""
        return (*self._nodes, *self._reserve)

    @property
    def drives(self) -> Mapping[FrameId, str]:
        """Names of the drives by their first frames, in order; empty for a map of one drive."""
        return MappingProxyType(self._drives)

    def drive_of(self, frame: FrameId) -> int:
        """Return the number of the drive of an image, counted from 1; 0 before the first drive with a name."""
        return bisect_right(list(self._drives), frame)

    @property
    def reserve(self) -> KeysView[FrameId]:
        """T': frames that are not nodes but may become nodes."""
        return self._reserve.keys()

    @property
    def names(self) -> Mapping[str, NodeId]:
        """Nodes named by a person, by name; read only."""
        return MappingProxyType(self._names)

    def successors(self, node: NodeId) -> KeysView[NodeId]:
        """Nodes that edges lead to from `node`; empty for a node that is not in the map."""
        return self._successors.get(node, {}).keys()

    def predecessors(self, node: NodeId) -> KeysView[NodeId]:
        """Nodes from which edges lead to `node`; empty for a node that is not in the map."""
        return self._predecessors.get(node, {}).keys()

    def apply(self, delta: d.GraphDelta) -> None:
        """Change the map; raise MapError and leave it unchanged if the delta does not fit."""
        match delta:
            case d.EdgeAdded():
                self._add_edge(delta)
            case d.BeliefUpdated():
                self._update_belief(delta)
            case d.NodeAdded():
                self._add_node(delta)
            case d.EdgePruned():
                self._prune_edge(delta)
            case d.NodeDropped():
                self._drop_node(delta)
            case d.EdgeProtected(source, target, protected):
                self._edges[source, target] = replace(self._existing(source, target), protected=protected)
            case d.EdgeActionSet():
                self._set_action(delta)
            case d.PresenceObserved():
                self._observe_presence(delta)
            case d.NodeNamed():
                self._name_node(delta)
            case d.DriveBegun():
                self._drives = dict(sorted({**self._drives, delta.frame: delta.name}.items()))
            case d.FramesReserved():
                self._add_reserve(delta)
            case d.FramesReleased():
                self._release(delta)
            case _:
                assert_never(delta)
        self.version += 1

    def deltas(self, cause: d.Cause = d.Cause.LOAD) -> tuple[d.GraphDelta, ...]:
        """Return the shortest history whose fold equals this graph."""
        history: list[d.GraphDelta] = [d.NodeAdded(node, cause) for node in self._nodes.values()]
        history += [d.EdgeAdded(edge, cause) for edge in self._edges.values()]
        history += presence_deltas(self._presence, cause)
        history += [d.DriveBegun(frame, name, cause) for frame, name in self._drives.items()]
        if self._reserve:
            history.append(d.FramesReserved(tuple(self._reserve), cause))
        return tuple(history)

    def copy(self) -> Self:
        """Return an independent graph with the same content and version; much faster than a fold."""
        clone = copy(self)
        # Nodes, edges and drives are immutable, so both graphs may share them.
        clone._nodes = self._nodes.copy()
        clone._edges = self._edges.copy()
        clone._reserve = self._reserve.copy()
        clone._presence = self._presence.copy()
        clone._names = self._names.copy()
        clone._successors = {node: targets.copy() for node, targets in self._successors.items()}
        clone._predecessors = {node: sources.copy() for node, sources in self._predecessors.items()}
        return clone

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TopologicalGraph):
            return NotImplemented
        content = self._nodes, self._edges, self._presence, self._reserve, self._drives
        return content == (other._nodes, other._edges, other._presence, other._reserve, other._drives)

    __hash__ = None  # type: ignore[assignment]  # A graph changes, so it cannot be a key.

    def __repr__(self) -> str:
        return f"TopologicalGraph({len(self._nodes)} nodes, {len(self._edges)} edges, {len(self._reserve)} in reserve)"

    def _add_node(self, delta: d.NodeAdded) -> None:
        frame = delta.node.id
        require(frame not in self._nodes, f"Node {frame} is in the map already.")
        require(frame not in self._reserve, f"Frame {frame} is in the reserve; release it before it becomes a node.")
        self._give_name(frame, delta.node.name)
        self._nodes[frame] = delta.node
        self._successors[frame] = {}
        self._predecessors[frame] = {}

    def _drop_node(self, delta: d.NodeDropped) -> None:
        self._require_node(delta.node)
        incident = [(delta.node, other) for other in self._successors[delta.node]]
        incident += [(other, delta.node) for other in self._predecessors[delta.node]]
        for source, target in incident:
            self._remove_edge(source, target)
        self._names.pop(self._nodes[delta.node].name, None)
        del self._nodes[delta.node], self._successors[delta.node], self._predecessors[delta.node]

    def _add_edge(self, delta: d.EdgeAdded) -> None:
        edge = delta.edge
        self._require_node(edge.source)
        self._require_node(edge.target)
        if edge.source == edge.target:
            raise MapError(f"Node {edge.source} cannot have an edge to itself.")
        if edge.target in self._successors[edge.source]:
            raise MapError(f"{edge_name(edge)} is in the map already.")
        if not all(map(math.isfinite, edge.waypoint)):
            raise MapError(f"{edge_name(edge)} has a waypoint that is not finite.")
        check_edge(edge)
        self._edges[edge.source, edge.target] = edge
        self._successors[edge.source][edge.target] = None
        self._predecessors[edge.target][edge.source] = None

    def _update_belief(self, delta: d.BeliefUpdated) -> None:
        edge = self._existing(delta.source, delta.target)
        # Ten times as fast as `replace`: a long run has tens of thousands of these changes.
        known = edge.source, edge.target, edge.waypoint
        marks = edge.protected, edge.by_odometry, edge.action
        changed = d.Edge(*known, delta.belief, delta.attempts, delta.successes, *marks)
        check_edge(changed)
        self._edges[delta.source, delta.target] = changed

    def _prune_edge(self, delta: d.EdgePruned) -> None:
        edge = self._existing(delta.source, delta.target)
        by_hand = delta.cause in (d.Cause.HAND, d.Cause.LOAD)
        require(by_hand or not edge.protected, f"{edge_name(edge)} is protected; only a person may prune it.")
        self._remove_edge(delta.source, delta.target)

    def _set_action(self, delta: d.EdgeActionSet) -> None:
        changed = replace(self._existing(delta.source, delta.target), action=delta.action)
        check_edge(changed)
        self._edges[delta.source, delta.target] = changed

    def _observe_presence(self, delta: d.PresenceObserved) -> None:
        edge = self._existing(delta.source, delta.target)
        require(
            math.isfinite(delta.stamp), f"{edge_name(edge)} was observed at {delta.stamp} s; a moment must be finite."
        )
        key = delta.source, delta.target
        seen = (*self._presence.get(key, ()), PresenceObservation(delta.present, delta.stamp))
        self._presence[key] = seen[-MOST_PRESENCE_OBSERVATIONS:]

    def _name_node(self, delta: d.NodeNamed) -> None:
        self._require_node(delta.node)
        node = self._nodes[delta.node]
        self._give_name(delta.node, delta.name)
        if node.name != delta.name:
            self._names.pop(node.name, None)
        self._nodes[delta.node] = replace(node, name=delta.name, goal=delta.goal)

    def _give_name(self, node: NodeId, name: str) -> None:
        if name:
            holder = self._names.get(name, node)
            require(holder == node, f"Node {holder} is called {name!r} already; a name belongs to one node.")
            self._names[name] = node

    def _remove_edge(self, source: NodeId, target: NodeId) -> None:
        del self._edges[source, target]
        self._presence.pop((source, target), None)
        del self._successors[source][target]
        del self._predecessors[target][source]

    def _add_reserve(self, delta: d.FramesReserved) -> None:
        for frame in delta.frames:
            require(frame not in self._nodes, f"Frame {frame} is a node; it cannot also be in the reserve.")
            require(frame not in self._reserve, f"Frame {frame} is in the reserve already.")
        self._reserve.update(dict.fromkeys(delta.frames))

    def _release(self, delta: d.FramesReleased) -> None:
        for frame in delta.frames:
            require(frame in self._reserve, f"Frame {frame} is not in the reserve.")
        for frame in delta.frames:
            self._reserve.pop(frame, None)

    def _require_node(self, node: NodeId) -> None:
        if node not in self._nodes:
            raise MapError(f"Node {node} is not in the map, which has {len(self._nodes)} nodes.")

    def _existing(self, source: NodeId, target: NodeId) -> d.Edge:
        if (source, target) not in self._edges:
            raise MapError(f"Edge {source} -> {target} is not in the map.")
        return self._edges[source, target]


def is_action(text: str) -> bool:
    """Tell whether a text can be an edge's action; an empty text, which stands for no action, can."""
    return len(text) <= MAX_ACTION_LENGTH and text.isprintable()


def presence_deltas(
    presence: Mapping[EdgeKey, tuple[PresenceObservation, ...]], cause: d.Cause
) -> list[d.PresenceObserved]:
    """Return the deltas that restore the observations of edges."""
    return [
        d.PresenceObserved(source, target, present=each.present, stamp=each.stamp_s, cause=cause)
        for (source, target), observations in presence.items()
        for each in observations
    ]
