"""Breakpoints: conditions at which a run stops, written as a user types them: "prune", "edge 12->40", "margin < 0.2".

Owns the kinds of breakpoints, parsing and formatting of their text form, the test of one event, and the search for hits
in a live run or a recording. The text of an event comes from `analysis.event_text`, the state before it from the
timeline; the caller decides what happens at a hit.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias, assert_never

from ltvn_core.analysis.event_text import describe_event, edge_text
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.analysis.timeline_rows import is_other_plan
from ltvn_core.config import ROBUST, BeliefConfig
from ltvn_core.errors import OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.terminal_text import parse_number
from ltvn_core.types import NodeId

_EDGE = r"(\d+)\s*(?:->|→)\s*(\d+)"
_COMPARED = r"\s*([<>])\s*(\S+)"
_LOCALISATION = re.compile(rf"(margin|distance|r){_COMPARED}", re.IGNORECASE)
_ON_EDGE = re.compile(rf"(p|mu)\s*\(\s*{_EDGE}\s*\){_COMPARED}", re.IGNORECASE)
_AT_EDGE = re.compile(rf"edge\s+{_EDGE}", re.IGNORECASE)
_AT_NODE = re.compile(r"node\s+(\d+)", re.IGNORECASE)
_CROSSING = re.compile(r"p\s+crosses\s+(\S+)", re.IGNORECASE)


class BreakpointTrigger(StrEnum):
    """Kinds of events, by the names that a user types."""

    PRUNE = "prune"
    EXPANSION = "expand"
    COLLISION = "collision"
    REPLAN = "replan"
    FAILED_ATTEMPT = "failed leg"
    LOST = "lost"
    NO_PATH = "no path"
    HAND = "by hand"


class BreakpointQuantity(StrEnum):
    """Quantities that a condition can compare."""

    MARGIN = "margin"
    DISTANCE = "distance"
    REACHABILITY = "r"
    P = "p"
    MU = "mu"


@dataclass(frozen=True, slots=True)
class EventBreakpoint:
    """Stop at each event of one kind."""

    trigger: BreakpointTrigger


@dataclass(frozen=True, slots=True)
class BeliefCrossingBreakpoint:
    """Stop when p of any edge crosses a level, in either direction."""

    level: float
    is_prune_threshold: bool = False
    """Whether the level was given as R_p, the pruning threshold, and is shown by that name."""


@dataclass(frozen=True, slots=True)
class LocalisationBreakpoint:
    """Stop at each localisation whose margin, distance or reachability is below or above a value."""

    quantity: BreakpointQuantity
    less: bool
    """True for below the value, False for above it."""
    value: float


@dataclass(frozen=True, slots=True)
class EdgeBeliefBreakpoint:
    """Stop when p or mu of one edge starts to meet a condition; the next stop comes after the condition was false
    again."""

    quantity: BreakpointQuantity
    edge: EdgeKey
    less: bool
    value: float


@dataclass(frozen=True, slots=True)
class EdgeBreakpoint:
    """Stop whenever an edge is driven or changed."""

    edge: EdgeKey


@dataclass(frozen=True, slots=True)
class NodeBreakpoint:
    """Stop whenever the robot is at a node or drives to it, or when the node changes."""

    node: NodeId


Breakpoint: TypeAlias = (
    EventBreakpoint
    | BeliefCrossingBreakpoint
    | LocalisationBreakpoint
    | EdgeBeliefBreakpoint
    | EdgeBreakpoint
    | NodeBreakpoint
)

BREAKPOINT_EXAMPLES = (
    *(trigger.value for trigger in BreakpointTrigger),
    "p crosses R_p",
    "p crosses 0.5",
    "margin < 0.2",
    "distance > 1",
    "r < 0.6",
    "edge 12->40",
    "node 12",
    "p(12->40) < 0.5",
    "mu(12->40) > 1.5",
)
"""One example of each form, for help texts."""

_TRIGGERS = frozenset(trigger.value for trigger in BreakpointTrigger)


def parse_breakpoint(text: str, config: BeliefConfig = ROBUST.believing) -> Breakpoint:
    """Parse a breakpoint; "R_p" is the threshold of `config`.

    Raises OptionError, which lists the valid forms, for anything else.
    """
    words = " ".join(text.split())
    if found := _LOCALISATION.fullmatch(words):
        return LocalisationBreakpoint(
            BreakpointQuantity(found[1].lower()), found[2] == "<", parse_number(found[3], text, "no breakpoint")
        )
    if found := _ON_EDGE.fullmatch(words):
        edge = int(found[2]), int(found[3])
        return EdgeBeliefBreakpoint(
            BreakpointQuantity(found[1].lower()), edge, found[4] == "<", parse_number(found[5], text, "no breakpoint")
        )
    if found := _AT_EDGE.fullmatch(words):
        return EdgeBreakpoint((int(found[1]), int(found[2])))
    if found := _AT_NODE.fullmatch(words):
        return NodeBreakpoint(int(found[1]))
    if found := _CROSSING.fullmatch(words):
        if found[1].lower() == "r_p":
            return prune_threshold_breakpoint(config)
        return BeliefCrossingBreakpoint(parse_number(found[1], text, "no breakpoint"))
    if words.lower() in _TRIGGERS:
        return EventBreakpoint(BreakpointTrigger(words.lower()))
    raise OptionError(f"{text[:60]!r} is not a breakpoint; write one of: {', '.join(BREAKPOINT_EXAMPLES)}.")


def prune_threshold_breakpoint(config: BeliefConfig) -> BeliefCrossingBreakpoint:
    """Return the breakpoint for p crossing R_p, the threshold of `config`."""
    return BeliefCrossingBreakpoint(config.prune_below, is_prune_threshold=True)


def format_breakpoint(breakpoint_: Breakpoint) -> str:
    """Return the text of a breakpoint; parsing it gives the same breakpoint."""
    match breakpoint_:
        case EventBreakpoint(trigger):
            return trigger.value
        case BeliefCrossingBreakpoint(level, is_prune_threshold):
            return f"p crosses {'R_p' if is_prune_threshold else repr(level)}"
        case LocalisationBreakpoint(quantity, less, value):
            return f"{quantity} {'<' if less else '>'} {value!r}"
        case EdgeBeliefBreakpoint(quantity, edge, less, value):
            return f"{quantity}({edge[0]}->{edge[1]}) {'<' if less else '>'} {value!r}"
        case EdgeBreakpoint(edge):
            return f"edge {edge[0]}->{edge[1]}"
        case NodeBreakpoint(node):
            return f"node {node}"
    assert_never(breakpoint_)


@dataclass(frozen=True, slots=True)
class EventContext:
    """One event of a run, with the state before it."""

    timeline: Timeline
    number: int
    """Number of the event in the timeline."""

    @property
    def event(self) -> e.Event:
        """The event."""
        return self.timeline.events[self.number].event

    @property
    def plan(self) -> tuple[NodeId, ...] | None:
        """The previous path of this query, if the event is a plan; None for other events and for the first plan of a
        query."""
        plan = self.timeline.plan_of(self.number)
        return None if plan is None else plan.previous

    @property
    def key(self) -> EdgeKey | None:
        """The edge that the event added, or whose belief it changed; None for other events."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if isinstance(delta, d.EdgeAdded):
            return delta.edge.source, delta.edge.target
        return (delta.source, delta.target) if isinstance(delta, d.BeliefUpdated) else None

    @property
    def before(self) -> d.Belief | None:
        """The belief of edge `key` before the event; None if the event updates no belief."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if not isinstance(delta, d.BeliefUpdated):
            return None
        return self.belief_before((delta.source, delta.target))

    @property
    def after(self) -> d.Belief | None:
        """The belief of edge `key` after the event; None if there is no such edge."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if isinstance(delta, d.EdgeAdded):
            return delta.edge.belief
        return delta.belief if isinstance(delta, d.BeliefUpdated) else None

    @property
    def delta(self) -> d.GraphDelta | None:
        """The event's change of the map; None for other events and for bulk changes."""
        return self.event.delta if isinstance(self.event, e.GraphChanged) and not self.is_bulk else None

    @property
    def is_bulk(self) -> bool:
        """Whether the event is one of the many changes that build or load a map, which are not notable."""
        return isinstance(self.event, e.GraphChanged) and self.event.delta.cause in d.BULK_CAUSES

    def belief_before(self, edge: EdgeKey) -> d.Belief | None:
        """Return the belief of an edge before the event; None if the edge was not in the map."""
        return self.timeline.belief_before(edge, self.number)


def breakpoint_reason(breakpoint_: Breakpoint, occurrence: EventContext) -> str | None:
    """Return why a breakpoint is met, None if it is not."""
    match breakpoint_:
        case EventBreakpoint(trigger):
            return _event_reason(occurrence) if _is_triggered(trigger, occurrence) else None
        case BeliefCrossingBreakpoint(level=level):
            return _crossed(occurrence, level)
        case LocalisationBreakpoint():
            return _event_reason(occurrence) if _is_localised_so(breakpoint_, occurrence.event) else None
        case EdgeBeliefBreakpoint():
            return _event_reason(occurrence) if _became(breakpoint_, occurrence) else None
        case EdgeBreakpoint(edge):
            return _at_edge(occurrence, edge)
        case NodeBreakpoint(node):
            return _event_reason(occurrence) if _is_at_node(occurrence, node) else None
    assert_never(breakpoint_)


def _event_reason(occurrence: EventContext) -> str:
    return describe_event(occurrence.event).text


def _is_triggered(trigger: BreakpointTrigger, occurrence: EventContext) -> bool:
    event = occurrence.event
    delta = occurrence.delta
    match trigger:
        case BreakpointTrigger.PRUNE:
            return isinstance(delta, d.EdgePruned)
        case BreakpointTrigger.EXPANSION:
            return isinstance(delta, d.NodeAdded) and delta.cause in (d.Cause.EXPAND, d.Cause.NOVEL)
        case BreakpointTrigger.COLLISION:
            return isinstance(event, e.Collided)
        case BreakpointTrigger.REPLAN:
            before = occurrence.plan
            return before is not None and isinstance(event, e.Planned) and is_other_plan(event.nodes, before)
        case BreakpointTrigger.FAILED_ATTEMPT:
            return isinstance(event, e.AttemptEnded) and not event.succeeded
        case BreakpointTrigger.LOST:
            return isinstance(event, e.Localised) and event.node is None
        case BreakpointTrigger.NO_PATH:
            return isinstance(event, e.Planned) and not event.nodes
        case BreakpointTrigger.HAND:
            return delta is not None and delta.cause is d.Cause.HAND
    assert_never(trigger)


def _crossed(occurrence: EventContext, level: float) -> str | None:
    before = occurrence.before
    after = occurrence.after
    if occurrence.key is None or before is None or after is None or (before.p < level) == (after.p < level):
        return None
    return (
        f"p of {edge_text(occurrence.key)} {'fell' if after.p < level else 'rose'} from {before.p:.2f} to {after.p:.2f}"
    )


def _is_localised_so(condition: LocalisationBreakpoint, event: e.Event) -> bool:
    if not isinstance(event, e.Localised) or (event.node is None and condition.quantity is BreakpointQuantity.MARGIN):
        return False
    seen = {
        BreakpointQuantity.MARGIN: event.margin,
        BreakpointQuantity.DISTANCE: event.distance,
        BreakpointQuantity.REACHABILITY: event.reachability,
    }[condition.quantity]
    return _holds(seen, condition.value, less=condition.less)


def _became(condition: EdgeBeliefBreakpoint, occurrence: EventContext) -> bool:
    if occurrence.key != condition.edge or occurrence.after is None or occurrence.delta is None:
        return False
    now, then = (_of(belief, condition.quantity) for belief in (occurrence.after, occurrence.before))
    held = then is not None and _holds(then, condition.value, less=condition.less)
    return now is not None and not held and _holds(now, condition.value, less=condition.less)


def _of(belief: d.Belief | None, quantity: BreakpointQuantity) -> float | None:
    if belief is None:
        return None
    return belief.p if quantity is BreakpointQuantity.P else belief.mu


def _holds(number: float, value: float, *, less: bool) -> bool:
    return number < value if less else number > value


def _at_edge(occurrence: EventContext, edge: EdgeKey) -> str | None:
    """Return what happened to an edge; removing either of its nodes also removes the edge."""
    if isinstance(occurrence.delta, d.NodeDropped) and occurrence.delta.node in edge:
        return (
            f"{edge_text(edge)} left with node {occurrence.delta.node}"
            if occurrence.belief_before(edge) is not None
            else None
        )
    return (
        _event_reason(occurrence) if not occurrence.is_bulk and describe_event(occurrence.event).edge == edge else None
    )


def _is_at_node(occurrence: EventContext, node: NodeId) -> bool:
    return not occurrence.is_bulk and describe_event(occurrence.event).node == node


class BreakpointHit(NamedTuple):
    """An event that meets at least one breakpoint."""

    moment: Instant
    breakpoints: tuple[Breakpoint, ...]
    """The breakpoints that the event meets, in the given order."""
    why: str
    """Reason in one line of text."""


def breakpoint_hit(timeline: Timeline, event: int, breakpoints: Sequence[Breakpoint]) -> BreakpointHit | None:
    """Return the hit of event number `event`, None if it meets no breakpoint. Takes logarithmic time for each
    breakpoint."""
    context = EventContext(timeline, event)
    hits = [(each, why) for each in breakpoints if (why := breakpoint_reason(each, context)) is not None]
    if not hits:
        return None
    return BreakpointHit(
        moment=timeline.instant(event),
        breakpoints=tuple(each for each, _ in hits),
        why="; ".join(dict.fromkeys(why for _, why in hits)),
    )


def find_breakpoint_hits(timeline: Timeline, breakpoints: Sequence[Breakpoint]) -> Iterator[BreakpointHit]:
    """Yield all hits in a run so far, in order; linear in its events."""
    hits = (breakpoint_hit(timeline, event, breakpoints) for event in range(len(timeline.events)))
    return (hit for hit in hits if hit is not None)
