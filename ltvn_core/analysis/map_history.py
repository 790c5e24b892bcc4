"""All changes of the maps of one run, and the map after any number of them: as a graph, and as columns for drawing.

Owns the order of the changes, the start of each map, the cached maps for time travel, and the positions at which nodes
are drawn. A version is a number of map changes. The columns hold when each node and edge was added and removed, and its
beliefs; a few vectorised comparisons give the map at any version without replaying all changes. The map that the robot
navigates by is `ltvn_core.graph`.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.recorded_frames import GrowingTable
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.errors import MapError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.types import NodeId, Pose

NEVER = np.iinfo(np.int64).max
_STRIDE = 10_000
"""Number of changes between cached maps; replaying this number takes some tens of milliseconds."""
_MOST_KEPT = 12
"""Greatest number of cached maps; a map of 10,000 nodes and 50,000 edges takes about 10 MB."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GraphArrays:
    """A map at one moment, as arrays for drawing. For the same moment, the same object is returned."""

    ids: NDArray[np.int64]
    """(N,) node ids."""
    poses: NDArray[np.float64]
    """(N, 3) x_m, y_m, yaw_rad."""
    edges: NDArray[np.int64]
    """(E, 2) rows of source and target in `ids`."""
    p: NDArray[np.float64]
    """(E,) probability that the edge can be driven."""
    attempts: NDArray[np.int64]
    """(E,) number of attempts to drive the edge."""
    acts: NDArray[np.bool_]
    """(E,) whether the edge needs an action."""
    exits: NDArray[np.bool_]
    """(N,) whether an edge with an action begins at the node."""

    def poses_of(self, nodes: tuple[NodeId, ...]) -> NDArray[np.float64]:
        """Return the poses (K, 3) of the given nodes that are in the map, in the given order."""
        if not nodes or not len(self.ids):
            return self.poses[:0]
        order = np.argsort(self.ids)
        places = np.searchsorted(self.ids, nodes, sorter=order).clip(max=len(order) - 1)
        rows = order[places]
        return self.poses[rows[self.ids[rows] == np.array(nodes)]]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FadingEdges:
    """Edges that were recently added or removed."""

    segments: NDArray[np.float64]
    """(F, 2, 2) x_m, y_m of both ends."""
    ages_s: NDArray[np.float64]
    """(F,) seconds since the addition or removal."""


EMPTY_GRAPH = GraphArrays(
    ids=np.empty(0, np.int64),
    poses=np.empty((0, 3)),
    edges=np.empty((0, 2), np.int64),
    p=np.empty(0),
    attempts=np.empty(0, np.int64),
    acts=np.empty(0, np.bool_),
    exits=np.empty(0, np.bool_),
)

NO_FADING_EDGES = FadingEdges(np.empty((0, 2, 2)), np.empty(0))


class GraphHistory:
    """All maps of a run at all moments, as arrays."""

    def __init__(self) -> None:
        """Begin with an empty map."""
        self.version = 0
        """Number of changes so far; the map can be shown at any smaller number."""
        self._nodes = GrowingTable({"id": int, "x": float, "y": float, "yaw": float, "born": int, "died": int})
        edge = {"source": int, "target": int, "born": int, "died": int, "came_s": float, "went_s": float}
        self._edges = GrowingTable(edge)
        self._beliefs = GrowingTable({"edge": int, "at": int, "p": float, "attempts": int})
        self._actions = GrowingTable({"edge": int, "at": int, "acts": int})
        self._node_rows: dict[NodeId, int] = {}
        self._edge_rows: dict[EdgeKey, int] = {}
        self._touching: defaultdict[NodeId, list[EdgeKey]] = defaultdict(list)
        """All edges that a node had since it was added, in order of their addition."""
        self._latest: tuple[int, GraphArrays] = (0, EMPTY_GRAPH)

    def apply(self, delta: d.GraphDelta, stamp: float, pose: Pose | None = None) -> None:
        """Append a change at `stamp` seconds; a new node is drawn at `pose` (3,), or at its odometry pose without one.

        In a damaged recording, a change that does not fit leaves the map unchanged.
        """
        self.version += 1
        match delta:
            case d.NodeAdded(node, _) if node.id not in self._node_rows:
                x, y, yaw = node.odometry if pose is None else pose
                row = self._nodes.append(id=node.id, x=x, y=y, yaw=yaw, born=self.version, died=NEVER)
                self._node_rows[node.id] = row
            case d.NodeDropped(node, cause):
                self._drop(node, cause, stamp)
            case d.EdgeAdded(edge, cause):
                self._connect(edge, cause, stamp)
            case d.BeliefUpdated(source, target, belief, attempts):
                self._believe(self._edge_rows.get((source, target)), belief.p, attempts)
            case d.EdgePruned(source, target, cause):
                self._cut((source, target), cause, stamp)
            case d.EdgeActionSet(source, target, action):
                self._set_action(self._edge_rows.get((source, target)), action)
            case _:
                pass  # The node is there already, or the change is not drawn.

    def clear(self) -> None:
        """Remove all nodes and edges as of the next change, because another map begins with it."""
        for table, rows in ((self._nodes, self._node_rows), (self._edges, self._edge_rows)):
            table["died"][list(rows.values())] = self.version + 1
            rows.clear()
        self._touching.clear()

    def at(self, version: int) -> GraphArrays:
        """Return the map after the first `version` changes."""
        if version != self._latest[0]:
            self._latest = (version, self._view(version))
        return self._latest[1]

    def sizes(self) -> NDArray[np.int64]:
        """Return the number of nodes and edges (V + 1, 2) at each version, from 0 on."""
        return np.stack([self._alive(self._nodes), self._alive(self._edges)], axis=1)

    def added_edges(self, version: int, stamp: float, within_s: float) -> FadingEdges:
        """Return the edges of the map at `version` that were added in the last `within_s` seconds before `stamp`."""
        n = int(np.searchsorted(self._edges["born"], version, "right"))
        return self._fading(self._edges["came_s"][:n], self._edges["died"][:n] > version, stamp, within_s)

    def removed_edges(self, version: int, stamp: float, within_s: float) -> FadingEdges:
        """Return the edges missing at `version` that were removed in the last `within_s` seconds before `stamp`."""
        n = int(np.searchsorted(self._edges["born"], version, "right"))
        return self._fading(self._edges["went_s"][:n], self._edges["died"][:n] <= version, stamp, within_s)

    def _connect(self, edge: d.Edge, cause: d.Cause, stamp: float) -> None:
        source = self._node_rows.get(edge.source)
        target = self._node_rows.get(edge.target)
        if source is None or target is None or source == target or (edge.source, edge.target) in self._edge_rows:
            return
        added_edges = -np.inf if cause in d.BULK_CAUSES else stamp
        row = self._edges.append(
            source=source, target=target, born=self.version, died=NEVER, came_s=added_edges, went_s=-np.inf
        )
        self._edge_rows[edge.source, edge.target] = row
        for node in (edge.source, edge.target):
            self._touching[node].append((edge.source, edge.target))
        self._believe(row, edge.belief.p, edge.attempts)
        if edge.action:
            self._set_action(row, edge.action)

    def _believe(self, row: int | None, p: float, attempts: int) -> None:
        if row is not None:
            self._beliefs.append(edge=row, at=self.version, p=p, attempts=attempts)

    def _set_action(self, row: int | None, action: str) -> None:
        if row is not None:
            self._actions.append(edge=row, at=self.version, acts=int(bool(action)))

    def _cut(self, pair: tuple[NodeId, NodeId], cause: d.Cause, stamp: float) -> None:
        row = self._edge_rows.pop(pair, None)
        if row is not None:
            self._edges["died"][row] = self.version
            self._edges["went_s"][row] = -np.inf if cause in d.BULK_CAUSES else stamp

    def _drop(self, node: NodeId, cause: d.Cause, stamp: float) -> None:
        row = self._node_rows.pop(node, None)
        if row is None:
            return
        self._nodes["died"][row] = self.version
        for pair in self._touching.pop(node, ()):
            self._cut(pair, cause, stamp)

    def _view(self, version: int) -> GraphArrays:
        n = int(np.searchsorted(self._nodes["born"], version, "right"))
        e = int(np.searchsorted(self._edges["born"], version, "right"))
        b = int(np.searchsorted(self._beliefs["at"], version, "right"))
        alive = np.flatnonzero(self._nodes["died"][:n] > version)
        renumbered = np.zeros(n, np.int64)
        renumbered[alive] = np.arange(len(alive))
        kept = np.flatnonzero(self._edges["died"][:e] > version)
        ends = np.stack([self._edges["source"][kept], self._edges["target"][kept]], axis=1)
        p = np.zeros(e)
        attempts = np.zeros(e, np.int64)
        # Where an index repeats, numpy keeps the last value, which is the latest belief.
        p[self._beliefs["edge"][:b]] = self._beliefs["p"][:b]
        attempts[self._beliefs["edge"][:b]] = self._beliefs["attempts"][:b]
        acts = np.zeros(e, np.bool_)
        a = int(np.searchsorted(self._actions["at"], version, "right"))
        acts[self._actions["edge"][:a]] = self._actions["acts"][:a]
        ids = self._nodes["id"][alive]
        rows = renumbered[ends]
        exits = np.zeros(len(ids), np.bool_)
        exits[rows[acts[kept], 0]] = True
        return GraphArrays(
            ids=ids,
            poses=np.stack([self._nodes[axis][alive] for axis in ("x", "y", "yaw")], axis=1),
            edges=rows,
            p=p[kept],
            attempts=attempts[kept],
            acts=acts[kept],
            exits=exits,
        )

    def _alive(self, table: GrowingTable) -> NDArray[np.int64]:
        born = np.bincount(table["born"], minlength=self.version + 1)
        died = np.bincount(table["died"][table["died"] <= self.version], minlength=self.version + 1)
        return np.cumsum(born - died)

    def _fading(self, stamps: NDArray, candidate: NDArray, stamp: float, within_s: float) -> FadingEdges:
        rows = np.flatnonzero(candidate & (stamps > stamp - within_s) & (stamps <= stamp))
        if not len(rows):
            return NO_FADING_EDGES
        ends = np.stack([self._edges["source"][rows], self._edges["target"][rows]], axis=1)
        points = np.stack([self._nodes["x"], self._nodes["y"]], axis=1)
        return FadingEdges(points[ends], stamp - stamps[rows])


class MapReplay:
    """A map that is replayed change by change, and is empty again when the next map begins."""

    def __init__(self, graph: TopologicalGraph | None = None, epoch: int = 0) -> None:
        """Begin with an empty map, or with a given one of map number `epoch`."""
        self.graph = TopologicalGraph() if graph is None else graph
        self._epoch = epoch

    def copy(self) -> "MapReplay":
        """Return an independent copy at the same change."""
        return MapReplay(self.graph.copy(), self._epoch)

    def take(self, change: MapChange) -> None:
        """Apply a change, or skip one that does not fit, whereas `TopologicalGraph` raises an error.

        Constant time, except for the removal of a node with many edges.
        """
        if change.epoch != self._epoch:
            self.graph = TopologicalGraph()
            self._epoch = change.epoch
        with suppress(MapError):
            self.graph.apply(change.delta)


class MapHistory:
    """The changes of the maps of one run, which may still grow.

    A recording holds several maps if another one was loaded, or if the map was rebuilt.
    """

    def __init__(self) -> None:
        """Begin with an empty map and no change."""
        self.changes: list[MapChange] = []
        self.epochs: list[int] = []
        """Index in `changes` at which each map begins."""
        self.begun_by: dict[int, int] = {}
        """Number of the map, from 0, for each event with which a whole map begins."""
        self.drawing = GraphHistory()
        """The same maps as arrays for drawing."""
        self._nodes: set[NodeId] = set()
        """Nodes of the present map."""
        self._by_edge: dict[EdgeKey, list[MapChange]] = {}
        self._by_node: dict[NodeId, list[MapChange]] = {}
        self._filed = 0
        """Number of changes indexed by edge and node; the rest are indexed on demand."""
        self._kept: dict[int, MapReplay] = {}

    def copy(self) -> "MapHistory":
        """Return a copy that does not change when this one grows; nothing may be appended to the copy."""
        self._file()
        twin = copy(self)
        twin.changes = list(self.changes)
        twin.epochs = list(self.epochs)
        return twin

    def append(self, event: int, instant: Instant, changed: GraphChanged, pose: Pose | None) -> None:
        """Add the change of event number `event`.

        A new node is drawn at `pose` (3,), or at its odometry pose without one. Constant time, except for the removal
        of a node with many edges.
        """
        delta = changed.delta
        fresh = isinstance(delta, d.NodeAdded) and delta.cause in d.BULK_CAUSES and self._begins_map(delta)
        if fresh or not self.epochs:
            self.epochs.append(len(self.changes))
            self.drawing.clear()
            self._nodes.clear()
        if isinstance(delta, d.NodeAdded):
            self._nodes.add(delta.node.id)
        elif isinstance(delta, d.NodeDropped):
            self._nodes.discard(delta.node)
        epoch = len(self.epochs) - 1
        version = len(self.changes) - self.epochs[-1] + 1
        self.changes.append(MapChange(event, instant, epoch, version, delta, changed.query, changed.attempt))
        self.drawing.apply(delta, instant.stamp, pose)
        if fresh:
            self.begun_by[event] = epoch

    def _begins_map(self, delta: d.NodeAdded) -> bool:
        """Tell whether a whole map begins with a node that is added in bulk."""
        last = self.changes[-1].delta if self.changes else None
        if last is None or last.cause is not delta.cause or delta.node.id in self._nodes:
            return True
        # A loaded map adds all its nodes before its edges; a map that is being built adds each node with its edges.
        allowed = d.NodeAdded if delta.cause is d.Cause.LOAD else d.NodeAdded | d.EdgeAdded
        return not isinstance(last, allowed)

    def count_before(self, event: int) -> int:
        """Return the number of changes before event number `event`. Takes logarithmic time."""
        return bisect_left(self.changes, event, key=_number)

    def graph_after(self, count: int) -> TopologicalGraph:
        """Return the map after the first `count` changes; the caller may change it.

        Copies one cached map and replays at most 10,000 changes; the first call may replay more.
        """
        kept = self._kept  # Another thread may replace the cache in between.
        known = max((place for place in kept if place <= count), default=0)
        replay = kept[known].copy() if known else MapReplay()
        for place in range(known, count):
            replay.take(self.changes[place])
            if (place + 1) % _STRIDE == 0:
                self._keep(place + 1, replay.copy())
        return replay.graph

    def of_edge(self, edge: EdgeKey) -> Sequence[MapChange]:
        """Return all changes of an edge in order; empty if the edge was never in the map."""
        return self._known(self._by_edge, edge)

    def of_node(self, node: NodeId) -> Sequence[MapChange]:
        """Return all additions and removals of a node, in order."""
        return self._known(self._by_node, node)

    def _known(self, filed: Mapping, key: EdgeKey | NodeId) -> tuple[MapChange, ...]:
        """Return the changes of an edge or node up to this copy's last one; the index is shared with the original."""
        self._file()
        rows = filed.get(key, ())
        return tuple(rows[: bisect_left(rows, len(self.changes) and self.changes[-1].event + 1, key=_number)])

    def _file(self) -> None:
        """Add the new changes to the indices by edge and by node."""
        for place in range(self._filed, len(self.changes)):
            self._file_change(self.changes[place])
        self._filed = len(self.changes)

    def _file_change(self, change: MapChange) -> None:
        match change.delta:
            case (
                d.EdgeAdded(edge=d.Edge(source=source, target=target))
                | d.BeliefUpdated(source=source, target=target)
                | d.EdgePruned(source=source, target=target)
                | d.PresenceObserved(source=source, target=target)
            ):
                self._by_edge.setdefault((source, target), []).append(change)
            case d.NodeAdded(node=d.Node(id=node)) | d.NodeDropped(node=node):
                self._by_node.setdefault(node, []).append(change)
            case _:
                pass  # The others are never looked up by edge or node.

    def _keep(self, place: int, replay: MapReplay) -> None:
        kept = {**self._kept, place: replay}
        if len(kept) > _MOST_KEPT:
            # Drop every second one, so that the rest is still spread over the whole run.
            kept = {place: kept[place] for place in sorted(kept)[1::2]}
        self._kept = kept


def _number(change: MapChange) -> int:
    return change.event
