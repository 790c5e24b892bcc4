"""Which events get a mark on a timeline, and at which of them one stops who steps through the run.

Owns both choices, for the page's timeline and for the debugger. What a mark says is `navigation.event_text`, how it
looks is the page's.
"""

from typing import NamedTuple, assert_never

from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind
from ltvn_core.graph import deltas as d
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_text import describe_event
from ltvn_core.types import NodeId
from ltvn_core.worlds.world_change import DoorMoved, PersonLeft, PersonMoved

_EXPANSION_CAUSES = (d.Cause.EXPAND, d.Cause.NOVEL)
_STOPS = frozenset(MarkKind) - {
    MarkKind.ADD,
    MarkKind.SEEN_OPEN,
    MarkKind.SEEN_BLOCKED,
    MarkKind.DOOR_OPENED,
    MarkKind.DOOR_CLOSED,
    MarkKind.WORLD,
}
"""The others come by the dozen, or are no doing of the robot: they are shown, and passed over."""


class EventMark(NamedTuple):
    """What an event's mark stands for."""

    kind: MarkKind
    about: tuple[int, ...] = ()
    """The nodes, two of an edge; or the number of a door."""


def mark_of(index: int, instant: Instant, event: e.Event, last_plan: tuple[NodeId, ...] | None) -> Mark | None:
    """Return an event as a stop for who steps through the run, None if it is none; see `event_mark`."""
    found = event_mark(event, last_plan)
    if found is None or found.kind not in _STOPS:
        return None
    return Mark(kind=found.kind, instant=instant, event=index, ids=found.about, text=describe_event(event).text)


def is_other_plan(nodes: tuple[NodeId, ...], last_plan: tuple[NodeId, ...]) -> bool:
    """Tell whether a path is not just the rest of the one planned before; that a path is gone counts as another."""
    is_rest = nodes == last_plan[len(last_plan) - len(nodes) :] if 0 < len(nodes) <= len(last_plan) else False
    return not is_rest and nodes != last_plan


def event_mark(event: e.Event, last_plan: tuple[NodeId, ...] | None) -> EventMark | None:
    """Return an event's mark, None if it gets none; `last_plan` is the path planned before in this query."""
    match event:
        case e.QueryStarted(goal=goal):
            return EventMark(MarkKind.QUERY_START, (goal,))
        case e.QueryEnded(goal=goal):
            return EventMark(MarkKind.QUERY_END, (goal,))
        case e.Collided():
            return EventMark(MarkKind.COLLISION)
        case e.AttemptEnded(source=source, target=target, succeeded=False):
            return EventMark(MarkKind.FAILURE, (target,) if source is None else (source, target))
        case e.Planned(nodes=nodes) if last_plan is not None and is_other_plan(nodes, last_plan):
            return EventMark(MarkKind.REPLAN, (*nodes[:1], *nodes[-1:]))
        case e.GraphChanged(delta=delta):
            return None if delta.cause in d.BULK_CAUSES else _mark_of_change(delta)
        case e.WorldChanged(change=DoorMoved(door=door, is_open=is_open)):
            return EventMark(MarkKind.DOOR_OPENED if is_open else MarkKind.DOOR_CLOSED, (door,))
        case e.WorldChanged(change=change):
            return None if isinstance(change, PersonMoved | PersonLeft) else EventMark(MarkKind.WORLD)
        case (
            e.StateChanged()
            | e.Localised()
            | e.Planned()
            | e.AttemptStarted()
            | e.AttemptEnded()
            | e.Judged()
            | e.Note()
        ):
            return None
    assert_never(event)


def _mark_of_change(delta: d.GraphDelta) -> EventMark | None:
    match delta:
        case d.EdgePruned(source=source, target=target):
            return EventMark(MarkKind.PRUNE, (source, target))
        case d.NodeDropped(node=node):
            return EventMark(MarkKind.PRUNE, (node,))
        case d.NodeAdded(node=node, cause=cause):
            return EventMark(MarkKind.EXPAND if cause in _EXPANSION_CAUSES else MarkKind.ADD, (node.id,))
        case d.EdgeAdded(edge=edge):
            return EventMark(MarkKind.ADD, (edge.source, edge.target))
        case d.PresenceObserved(source=source, target=target, present=present):
            return EventMark(MarkKind.SEEN_OPEN if present else MarkKind.SEEN_BLOCKED, (source, target))
        case (
            d.BeliefUpdated()
            | d.EdgeProtected()
            | d.NodeNamed()
            | d.ViewAdded()
            | d.ViewUsed()
            | d.ViewDropped()
            | d.DriveBegun()
            | d.FramesReserved()
            | d.FramesReleased()
        ):
            return None
    assert_never(delta)
