"""Which events get a mark on the slider. What a mark says is `navigation.event_text`.

Owns the choice. What lies between two marks is no concern of it.
"""

from typing import assert_never

from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind
from ltvn_core.graph import deltas as d
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_text import describe_event
from ltvn_core.types import NodeId

_EXPANSION_CAUSES = (d.Cause.EXPAND, d.Cause.NOVEL)


def mark_of(index: int, instant: Instant, event: e.Event, last_plan: tuple[NodeId, ...] | None) -> Mark | None:
    """Return the mark of an event, None if it gets none; `last_plan` is the path planned before in this query."""
    found = _kind_and_nodes(event, last_plan)
    if found is None:
        return None
    kind, nodes = found
    return Mark(kind=kind, instant=instant, event=index, ids=nodes, text=describe_event(event).text)


def is_other_plan(nodes: tuple[NodeId, ...], last_plan: tuple[NodeId, ...]) -> bool:
    """Tell whether a path is not just the rest of the one planned before; that a path is gone counts as another."""
    is_rest = nodes == last_plan[len(last_plan) - len(nodes) :] if 0 < len(nodes) <= len(last_plan) else False
    return not is_rest and nodes != last_plan


def _kind_and_nodes(event: e.Event, last_plan: tuple[NodeId, ...] | None) -> tuple[MarkKind, tuple[NodeId, ...]] | None:
    """Return what kind of mark an event gets and the nodes it is about."""
    match event:
        case e.QueryStarted(goal=goal):
            return MarkKind.QUERY_START, (goal,)
        case e.QueryEnded(goal=goal):
            return MarkKind.QUERY_END, (goal,)
        case e.Collided():
            return MarkKind.COLLISION, ()
        case e.AttemptEnded(source=source, target=target, succeeded=False):
            return MarkKind.FAILURE, (target,) if source is None else (source, target)
        case e.Planned(nodes=nodes) if last_plan is not None and is_other_plan(nodes, last_plan):
            return MarkKind.REPLAN, (*nodes[:1], *nodes[-1:])
        case e.GraphChanged(delta=delta):
            return _change_kind_and_nodes(delta)
        case (
            e.StateChanged()
            | e.Localised()
            | e.Planned()
            | e.AttemptStarted()
            | e.AttemptEnded()
            | e.Judged()
            | e.Note()
            | e.WorldChanged()
        ):
            return None
    assert_never(event)


def _change_kind_and_nodes(delta: d.GraphDelta) -> tuple[MarkKind, tuple[NodeId, ...]] | None:
    match delta:
        case d.EdgePruned(source=source, target=target):
            return MarkKind.PRUNE, (source, target)
        case d.NodeDropped(node=node, cause=cause):
            return None if cause in d.BULK_CAUSES else (MarkKind.PRUNE, (node,))
        case d.NodeAdded(node=node, cause=cause):
            return (MarkKind.EXPAND, (node.id,)) if cause in _EXPANSION_CAUSES else None
        case (
            d.EdgeAdded()
            | d.BeliefUpdated()
            | d.EdgeProtected()
            | d.PresenceObserved()
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
