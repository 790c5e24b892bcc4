"""When a breakpoint is met: one event, what was believed and planned before it, and a reason in words.

Owns these rules and the memory they need, which is one belief per edge and the last plan.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

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
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId


@dataclass(slots=True)
class EventContext:
    """One event, beside what held before it."""

    event: e.Event
    plan: tuple[NodeId, ...] | None
    """The plan before, None when the query had none yet."""
    known_beliefs: Mapping[EdgeKey, d.Belief]
    """Beliefs by edge."""
    key: EdgeKey | None = None
    """The edge whose belief the event changed."""
    before: d.Belief | None = None
    after: d.Belief | None = None

    @property
    def delta(self) -> d.GraphDelta | None:
        """The change of the map that the event tells, bulk ones left out."""
        delta = self.event.delta if isinstance(self.event, e.GraphChanged) else None
        return None if delta is None or delta.cause in d.BULK_CAUSES else delta


@dataclass(slots=True)
class BreakpointMemory:
    """What conditions look back at: beliefs and the plan."""

    beliefs: dict[EdgeKey, d.Belief] = field(default_factory=dict)
    plan: tuple[NodeId, ...] | None = None

    def take(self, event: e.Event) -> EventContext:
        """Remember an event and return it beside what held before."""
        occurrence = EventContext(event, self.plan, self.beliefs)
        match event:
            case e.QueryStarted():
                self.plan = None
            case e.Planned(nodes=nodes):
                self.plan = nodes
            case e.GraphChanged(delta=delta):
                self._believe(delta, occurrence)
        return occurrence

    def _believe(self, delta: d.GraphDelta, occurrence: EventContext) -> None:
        match delta:
            case d.EdgeAdded(edge=edge):
                occurrence.key, occurrence.after = (edge.source, edge.target), edge.belief
            case d.BeliefUpdated(source=source, target=target, belief=belief):
                occurrence.key, occurrence.after = (source, target), belief
                occurrence.before = self.beliefs.get(occurrence.key)
            case d.EdgePruned(source=source, target=target):
                self.beliefs.pop((source, target), None)
        if occurrence.key is not None and occurrence.after is not None:
            self.beliefs[occurrence.key] = occurrence.after


def breakpoint_reason(breakpoint_: Breakpoint, occurrence: EventContext) -> str | None:
    """Say why a breakpoint is met, None if it is not."""
    match breakpoint_:
        case EventBreakpoint(trigger):
            return _REASONS[trigger](occurrence)
        case BeliefCrossingBreakpoint(level):
            return _crossed(occurrence, level)
        case LocalisationBreakpoint(quantity, less, value):
            return _localised(occurrence.event, quantity, value, less=less)
        case EdgeBeliefBreakpoint():
            return _became(breakpoint_, occurrence)
        case EdgeBreakpoint(edge):
            return _at_edge(occurrence, edge)
        case NodeBreakpoint(node):
            return _at_node(occurrence, node)


def _pruned(occurrence: EventContext) -> str | None:
    match occurrence.delta:
        case d.EdgePruned(source=source, target=target):
            return f"{_arrow((source, target))} was pruned"
    return None


def _expanded(occurrence: EventContext) -> str | None:
    match occurrence.delta:
        case d.NodeAdded(node=node, cause=d.Cause.EXPAND | d.Cause.NOVEL as cause):
            return f"node {node.id} came into the map ({cause})"
    return None


def _collided(occurrence: EventContext) -> str | None:
    return f"collision {occurrence.event.count}" if isinstance(occurrence.event, e.Collided) else None


def _replanned(occurrence: EventContext) -> str | None:
    before = occurrence.plan
    if before is None or not isinstance(occurrence.event, e.Planned):
        return None
    nodes = occurrence.event.nodes
    if nodes and nodes != before[len(before) - len(nodes) :]:  # The end of the same plan is no other plan.
        return f"another plan: {len(nodes)} nodes instead of {len(before)}"
    return "the plan is gone" if before and not nodes else None


def _attempt_failed(occurrence: EventContext) -> str | None:
    match occurrence.event:
        case e.AttemptEnded(attempt=attempt, source=source, target=target, succeeded=False, reason=reason):
            return f"leg {attempt} from {'here' if source is None else source} to {target} failed: {reason}"
    return None


def _lost(occurrence: EventContext) -> str | None:
    match occurrence.event:
        case e.Localised(node=None, distance=distance):
            return f"lost: the best node is {distance:.2f} away"
    return None


def _without_path(occurrence: EventContext) -> str | None:
    match occurrence.event:
        case e.Planned(nodes=()):
            return "no path to the goal"
    return None


def _by_hand(occurrence: EventContext) -> str | None:
    if occurrence.delta is not None and occurrence.delta.cause is d.Cause.HAND:
        return f"a person changed the map ({type(occurrence.delta).__name__})"
    return None


_REASONS: dict[BreakpointTrigger, Callable[[EventContext], str | None]] = {
    BreakpointTrigger.PRUNE: _pruned,
    BreakpointTrigger.EXPANSION: _expanded,
    BreakpointTrigger.COLLISION: _collided,
    BreakpointTrigger.REPLAN: _replanned,
    BreakpointTrigger.FAILED_ATTEMPT: _attempt_failed,
    BreakpointTrigger.LOST: _lost,
    BreakpointTrigger.NO_PATH: _without_path,
    BreakpointTrigger.HAND: _by_hand,
}


def _crossed(occurrence: EventContext, level: float) -> str | None:
    before, after = occurrence.before, occurrence.after
    if occurrence.key is None or before is None or after is None or (before.p < level) == (after.p < level):
        return None
    return f"p of {_arrow(occurrence.key)} {'fell' if after.p < level else 'rose'} from {before.p:.2f} to {after.p:.2f}"


def _localised(event: e.Event, quantity: BreakpointQuantity, value: float, *, less: bool) -> str | None:
    if not isinstance(event, e.Localised) or (event.node is None and quantity is BreakpointQuantity.MARGIN):
        return None
    seen = {
        BreakpointQuantity.MARGIN: event.margin,
        BreakpointQuantity.DISTANCE: event.distance,
        BreakpointQuantity.REACHABILITY: event.reachability,
    }[quantity]
    if not _holds(seen, value, less=less):
        return None
    where = "lost" if event.node is None else f"at {event.node}"
    return f"{quantity} {seen:.2f}, {where}, second best {event.runner_up}"


def _became(condition: EdgeBeliefBreakpoint, occurrence: EventContext) -> str | None:
    if occurrence.key != condition.edge or occurrence.after is None or occurrence.delta is None:
        return None
    now, then = (_of(belief, condition.quantity) for belief in (occurrence.after, occurrence.before))
    held = then is not None and _holds(then, condition.value, less=condition.less)
    if now is None or held or not _holds(now, condition.value, less=condition.less):
        return None
    return f"{condition.quantity} of {_arrow(condition.edge)} is {now:.2f}"


def _of(belief: d.Belief | None, quantity: BreakpointQuantity) -> float | None:
    if belief is None:
        return None
    return belief.p if quantity is BreakpointQuantity.P else belief.mu


def _holds(number: float, value: float, *, less: bool) -> bool:
    return number < value if less else number > value


def _at_edge(occurrence: EventContext, edge: EdgeKey) -> str | None:
    match occurrence.event:
        case e.AttemptStarted(source=source, target=target) if (source, target) == edge:
            return f"sets off along {_arrow(edge)}"
        case e.AttemptEnded(source=source, target=target, succeeded=succeeded) if (source, target) == edge:
            return f"{_arrow(edge)} {'succeeded' if succeeded else 'failed'}"
    match occurrence.delta:
        case d.EdgeAdded(edge=added) if (added.source, added.target) == edge:
            return f"{_arrow(edge)} came into the map"
        case d.EdgePruned(source=source, target=target) if (source, target) == edge:
            return f"{_arrow(edge)} was pruned"
        case d.BeliefUpdated(source=source, target=target, belief=belief) if (source, target) == edge:
            return f"p of {_arrow(edge)} is {belief.p:.2f}"
        case d.EdgeProtected(source=source, target=target) if (source, target) == edge:
            return f"{_arrow(edge)} changed its protection"
        case d.NodeDropped(node=node) if node in edge and edge in occurrence.known_beliefs:
            return f"{_arrow(edge)} left with node {node}"
    return None


def _at_node(occurrence: EventContext, node: NodeId) -> str | None:
    match occurrence.event:
        case e.Localised(node=here) if here == node:
            return f"at node {node}"
        case e.AttemptStarted(target=target) if target == node:
            return f"sets off to node {node}"
        case e.QueryStarted(goal=goal) if goal == node:
            return f"node {node} is the goal"
    match occurrence.delta:
        case d.NodeAdded(node=added) if added.id == node:
            return f"node {node} came into the map"
        case d.NodeDropped(node=dropped) if dropped == node:
            return f"node {node} left the map"
        case d.NodeNamed(node=named, name=name) if named == node:
            return f"node {node} is called {name!r}"
    return None


def _arrow(edge: EdgeKey) -> str:
    return f"edge {edge[0]}->{edge[1]}"
