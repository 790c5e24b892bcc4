"""Setbacks: what goes wrong within a query, and what the robot never recovered from.

Owns that rule: a robot has recovered as soon as a plan shows it nearer to its goal than it ever was before the setback.
An attempt that succeeds is not enough, for a robot that is stuck drives to and fro, and half of its attempts succeed.
"""

from collections import Counter
from math import inf
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import QueryRecord
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.event_text import describe_event
from ltvn_core.navigation.events import (
    AttemptStarted,
    Collided,
    Event,
    GraphChanged,
    Localised,
    Planned,
    Severity,
)
from ltvn_core.types import NodeId

_NEARER = 0.2
"""So much cheaper must the plan have become; less may come from new beliefs alone (ours)."""


class Setback(NamedTuple):
    """Something that went wrong."""

    event: int
    """Index in the timeline's events."""
    text: str
    edge: EdgeKey | None
    """The edge that was driven then."""
    node: NodeId | None
    """Where the robot last thought it was."""


class _SetbackTracker:
    """Follows a query."""

    def __init__(self) -> None:
        self.collisions: list[Setback] = []
        self.setback: Setback | None = None
        """The first one that was not recovered from, as yet."""
        self._cheapest = inf
        self._cheapest_before = inf
        self._node: NodeId | None = None
        self._edge: EdgeKey | None = None

    def take(self, index: int, event: Event) -> None:
        description = describe_event(event)
        if isinstance(event, Localised):
            self._node = self._node if event.node is None else event.node
            self._edge = None
        elif isinstance(event, AttemptStarted):
            self._edge = None if event.source is None else (event.source, event.target)
        elif isinstance(event, Planned) and event.nodes:
            self._nearer(event.cost)
        if not _is_setback(event, description.severity):
            return
        setback = Setback(event=index, text=description.sentence, edge=self._edge, node=self._node)
        if isinstance(event, Collided):
            self.collisions.append(setback)
        if self.setback is None:
            self.setback = setback
            self._cheapest_before = self._cheapest

    def _nearer(self, cost: float) -> None:
        if self.setback is not None and cost < self._cheapest_before - _NEARER:
            self.setback = None
        self._cheapest = min(self._cheapest, cost)


def first_setback(timeline: Timeline, query: QueryRecord) -> Setback | None:
    """Return the first thing in a query that it never recovered from, None if all was well; linear in its events."""
    return _tracked(timeline, query).setback


def worst_collision(timeline: Timeline, query: QueryRecord) -> Setback | None:
    """Return the first touch at the node where a query touched things most often; None without touches.

    Touches add up whether or not the robot recovers from each. Linear in its events.
    """
    collisions = _tracked(timeline, query).collisions
    counts = Counter(collision.node for collision in collisions)
    return max(collisions, key=lambda collision: counts[collision.node], default=None)


def _tracked(timeline: Timeline, query: QueryRecord) -> _SetbackTracker:
    watch = _SetbackTracker()
    for index in range(query.first, query.last + 1):
        watch.take(index, timeline.events[index].event)
    return watch


def _is_setback(event: Event, severity: Severity) -> bool:
    """Tell whether something went wrong; a change of the map is what follows from that, and no setback itself."""
    return severity is not Severity.INFO and not isinstance(event, GraphChanged)
