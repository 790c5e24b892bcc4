"""What goes wrong within a query, and what the robot never recovered from.

Owns that rule: a robot has recovered as soon as a plan shows it nearer to its goal than it ever was before the setback.
A leg that succeeds is not enough, for a robot in a jam drives to and fro, and half of its legs succeed.
"""

from collections import Counter
from math import inf
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import QueryRecord
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    Localised,
    Note,
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
        text = _setback_text(event)
        if isinstance(event, Localised):
            self._node = self._node if event.node is None else event.node
            self._edge = None
        elif isinstance(event, AttemptStarted):
            self._edge = None if event.source is None else (event.source, event.target)
        elif isinstance(event, Planned) and event.nodes:
            self._nearer(event.cost)
        if not text:
            return
        setback = Setback(index, text, self._edge, self._node)
        if isinstance(event, Collided):
            self.collisions.append(setback)
        if self.setback is None:
            self.setback, self._cheapest_before = setback, self._cheapest

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


def _setback_text(event: Event) -> str:
    """Say what is wrong with an event; empty if nothing is."""
    match event:
        case AttemptEnded(succeeded=False):
            along = f"{event.source} -> {event.target}" if event.source is not None else f"to node {event.target}"
            return f"Attempt {event.attempt} along {along} failed ({event.end.value}): {event.reason}."
        case Collided():
            return f"The robot touched something, for the {_ordinal(event.count)} time in the query."
        case Localised(node=None):
            return f"Nobody recognised what the robot saw; the best node was at d = {event.distance:.2f}."
        case Planned(nodes=()):
            return "There was no path."
        case Note(severity=Severity.WARN | Severity.ERROR):
            return event.text
    return ""


def _ordinal(number: int) -> str:
    ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
