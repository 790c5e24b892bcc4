"""All changes of the maps of one run, and the map after any number of them.

Owns the order of the changes, where each map begins, and the maps kept on the way for time travel. The map for drawing,
as arrays, is `analysis.graph_history`, which is fed here so that both always agree.
"""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from copy import copy

from ltvn_core.analysis.graph_history import GraphHistory
from ltvn_core.analysis.map_replay import MapEpochs, MapReplay
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.graph.deltas import (
    Belief,
    BeliefUpdated,
    DriveBegun,
    EdgeAdded,
    EdgeProtected,
    EdgePruned,
    FramesReleased,
    FramesReserved,
    NodeAdded,
    NodeDropped,
    NodeNamed,
    PresenceObserved,
    ViewAdded,
    ViewDropped,
    ViewUsed,
)
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.types import NodeId, Pose

_STRIDE = 10_000
"""A map is kept after so many changes; folding as many takes some tens of milliseconds."""
_MOST_KEPT = 12
"""A map of 10,000 nodes and 50,000 edges takes some 10 MB."""


class MapHistory:
    """The changes of the maps of one run, which may go on."""

    def __init__(self) -> None:
        """Begin with an empty map and no change."""
        self.changes: list[MapChange] = []
        self.epochs: list[int] = []
        """Where in `changes` each map begins."""
        self.begun_by: dict[int, int] = {}
        """The number of the map, from 0, that a whole map's first event brought in, by the number of that event."""
        self.drawing = GraphHistory()
        """The same maps as arrays."""
        self._by_edge: dict[EdgeKey, list[MapChange]] = {}
        self._by_node: dict[NodeId, list[MapChange]] = {}
        self._filed = 0
        """So many changes are filed by edge and node already; the rest waits until somebody asks."""
        self._epochs = MapEpochs()
        self._kept: dict[int, MapReplay] = {}

    def copy(self) -> "MapHistory":
        """Return one that stays as it is when this one goes on; it must not be appended to."""
        self._file()
        twin = copy(self)
        twin.changes = list(self.changes)
        twin.epochs = list(self.epochs)
        return twin

    def append(self, event: int, instant: Instant, changed: GraphChanged, pose: Pose | None) -> None:
        """Add the change of event number `event`.

        A node that comes in is drawn at `pose` (3,), or where odometry put it. Constant time, but for a node that
        leaves with many edges.
        """
        fresh = self._epochs.take(changed.delta)
        if fresh or not self.epochs:
            self.epochs.append(len(self.changes))
            self.drawing.clear()
        change = MapChange(
            event=event,
            instant=instant,
            epoch=self._epochs.current,
            version=self._epochs.version,
            delta=changed.delta,
            query=changed.query,
            attempt=changed.attempt,
        )
        self.changes.append(change)
        self.drawing.apply(change.delta, instant.stamp, pose)
        if fresh:
            self.begun_by[event] = change.epoch

    def count_before(self, event: int) -> int:
        """Return how many changes come before event number `event`. Logarithmic."""
        return bisect_left(self.changes, event, key=_number)

    def graph_after(self, count: int) -> TopologicalGraph:
        """Return the map after the first `count` changes, to be changed freely.

        One copy and at most 10,000 changes, once those before were folded.
        """
        kept = self._kept  # Another thread may replace it meanwhile.
        known = max((place for place in kept if place <= count), default=0)
        replay = kept[known].copy() if known else MapReplay()
        for place in range(known, count):
            replay.take(self.changes[place])
            if (place + 1) % _STRIDE == 0:
                self._keep(place + 1, replay.copy())
        return replay.graph

    def of_edge(self, edge: EdgeKey) -> Sequence[MapChange]:
        """Return all changes of an edge in order; none for an edge that never was."""
        return self._known(self._by_edge, edge)

    def of_node(self, node: NodeId) -> Sequence[MapChange]:
        """Return all arrivals and departures of a node, and of its views, in order."""
        return self._known(self._by_node, node)

    def belief_before(self, edge: EdgeKey, event: int) -> Belief | None:
        """Return what was believed of an edge just before event number `event`; None while it is not in the map.

        Of a recording whose beginning is cut off, beliefs count from their first update. Logarithmic.
        """
        self._file()
        last = _last_before(self._by_edge.get(edge, ()), event, passed_over=PresenceObserved)
        place = self.count_before(event)
        if last is None or last.epoch != self.changes[place - 1].epoch:
            return None
        for node in edge:
            moved = _last_before(self._by_node.get(node, ()), event)
            if moved is not None and moved.event > last.event and isinstance(moved.delta, NodeDropped):
                return None
        if isinstance(last.delta, EdgeAdded):
            return last.delta.edge.belief
        return last.delta.belief if isinstance(last.delta, BeliefUpdated) else None

    def _known(self, filed: Mapping, key: EdgeKey | NodeId) -> tuple[MapChange, ...]:
        """Leave out what came after this copy was made: the files by edge and node are shared with the original."""
        self._file()
        rows = filed.get(key, ())
        return tuple(rows[: bisect_left(rows, len(self.changes) and self.changes[-1].event + 1, key=_number)])

    def _file(self) -> None:
        """File by edge and node what came since the last time."""
        for place in range(self._filed, len(self.changes)):
            self._file_change(self.changes[place])
        self._filed = len(self.changes)

    def _file_change(self, change: MapChange) -> None:
        match change.delta:
            case EdgeAdded(edge=edge):
                self._by_edge.setdefault((edge.source, edge.target), []).append(change)
            case (
                BeliefUpdated(source=source, target=target)
                | EdgePruned(source=source, target=target)
                | PresenceObserved(source=source, target=target)
            ):
                self._by_edge.setdefault((source, target), []).append(change)
            case NodeAdded(node=node):
                self._by_node.setdefault(node.id, []).append(change)
            case NodeDropped(node=node) | ViewAdded(node=node) | ViewUsed(node=node) | ViewDropped(node=node):
                self._by_node.setdefault(node, []).append(change)
            case EdgeProtected() | NodeNamed() | DriveBegun() | FramesReserved() | FramesReleased():
                pass  # Nobody asks for these by edge or node.

    def _keep(self, place: int, replay: MapReplay) -> None:
        kept = {**self._kept, place: replay}
        if len(kept) > _MOST_KEPT:
            # Every second one goes, so that what is left is still spread over the whole run.
            kept = {place: kept[place] for place in sorted(kept)[1::2]}
        self._kept = kept


def _last_before(changes: Sequence[MapChange], event: int, *, passed_over: type | tuple[()] = ()) -> MapChange | None:
    place = bisect_left(changes, event, key=_number) - 1
    while place >= 0 and isinstance(changes[place].delta, passed_over):
        place -= 1
    return changes[place] if place >= 0 else None


def _number(change: MapChange) -> int:
    return change.event
