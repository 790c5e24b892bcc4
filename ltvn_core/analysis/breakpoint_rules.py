"""When a breakpoint is met: one event, what was believed and planned before it, and the reason.

The reason is what the event says (`navigation.event_text`). Owns these rules; what held before is the timeline's.
"""

from dataclasses import dataclass
from typing import assert_never

from ltvn_core.analysis.breakpoint_kinds import (
    BeliefCrossingBreakpoint,
    Breakpoint,
    BreakpointQuantity,
    BreakpointTrigger,
    EdgeBeliefBreakpoint,
    EdgeBreakpoint,
    EventBreakpoint,
    LocalisationBreakpoint,
    NodeBreakpoint,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_marks import is_other_plan
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_text import describe_event, edge_text
from ltvn_core.types import NodeId


@dataclass(frozen=True, slots=True)
class EventContext:
    """One event of a run, beside what held before it."""

    timeline: Timeline
    number: int
    """Of the event in the timeline."""

    @property
    def event(self) -> e.Event:
        """The event."""
        return self.timeline.events[self.number].event

    @property
    def plan(self) -> tuple[NodeId, ...] | None:
        """The path planned before the plan that this event is; None when the query had none yet."""
        plan = self.timeline.plan_of(self.number)
        return None if plan is None else plan.previous

    @property
    def key(self) -> EdgeKey | None:
        """The edge whose belief the event changed."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if isinstance(delta, d.EdgeAdded):
            return delta.edge.source, delta.edge.target
        return (delta.source, delta.target) if isinstance(delta, d.BeliefUpdated) else None

    @property
    def before(self) -> d.Belief | None:
        """What was believed of `key` before a belief update."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if not isinstance(delta, d.BeliefUpdated):
            return None
        return self.belief_before((delta.source, delta.target))

    @property
    def after(self) -> d.Belief | None:
        """What is believed of `key` with the event."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        if isinstance(delta, d.EdgeAdded):
            return delta.edge.belief
        return delta.belief if isinstance(delta, d.BeliefUpdated) else None

    @property
    def delta(self) -> d.GraphDelta | None:
        """The change of the map that the event tells, bulk ones left out."""
        return self.event.delta if isinstance(self.event, e.GraphChanged) and not self.is_bulk else None

    @property
    def is_bulk(self) -> bool:
        """The event is one of the many changes that make a map, which is no news."""
        return isinstance(self.event, e.GraphChanged) and self.event.delta.cause in d.BULK_CAUSES

    def belief_before(self, edge: EdgeKey) -> d.Belief | None:
        """Return what was believed of an edge before the event; None while it was not in the map."""
        return self.timeline.belief_before(edge, self.number)


def breakpoint_reason(breakpoint_: Breakpoint, occurrence: EventContext) -> str | None:
    """Say why a breakpoint is met, None if it is not."""
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
    event, delta = occurrence.event, occurrence.delta
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
    before, after = occurrence.before, occurrence.after
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
    """Say what happened to an edge, which leaves the map with either of its nodes as well."""
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
