"""Which events get a mark on the slider, and what it says.

Owns the choice and the words. What lies between two marks is no concern of it.
"""

from collections.abc import Iterator

from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind
from ltvn_core.graph.deltas import BULK_CAUSES, Cause, EdgePruned, GraphDelta, NodeAdded, NodeDropped
from ltvn_core.navigation.events import AttemptEnded, Collided, Event, GraphChanged, Planned, QueryEnded, QueryStarted
from ltvn_core.types import NodeId

_GROWN = (Cause.EXPAND, Cause.NOVEL)


def mark_of(index: int, instant: Instant, event: Event, last_plan: tuple[NodeId, ...] | None) -> Mark | None:
    """Return the mark of an event, None if it gets none; `last_plan` is the path planned before in this query."""

    def mark(kind: MarkKind, text: str, *ids: NodeId) -> Mark:
        return Mark(kind, instant, index, ids, text)

    match event:
        case QueryStarted():
            return mark(MarkKind.QUERY_START, f"query {event.query} to node {event.goal}", event.goal)
        case QueryEnded():
            return mark(MarkKind.QUERY_END, f"query {event.query} ended: {event.outcome.value}", event.goal)
        case Collided():
            return mark(MarkKind.COLLISION, f"touch {event.count} of query {event.query}")
        case AttemptEnded(succeeded=False):
            ids = (event.target,) if event.source is None else (event.source, event.target)
            return mark(MarkKind.FAILURE, f"attempt {event.attempt} failed, {event.end.value}: {event.reason}", *ids)
        case Planned() if last_plan is not None and not _continues(last_plan, event.nodes):
            way = f"a new path of {len(event.nodes)} nodes" if event.nodes else "no path any more"
            return mark(MarkKind.REPLAN, way, *event.nodes[:1], *event.nodes[-1:])
        case GraphChanged():
            return next((mark(kind, text, *ids) for kind, text, ids in _changed(event.delta)), None)
    return None


def _continues(last: tuple[NodeId, ...], nodes: tuple[NodeId, ...]) -> bool:
    return last[len(last) - len(nodes) :] == nodes if len(nodes) <= len(last) and nodes else nodes == last


def _changed(delta: GraphDelta) -> Iterator[tuple[MarkKind, str, tuple[NodeId, ...]]]:
    match delta:
        case EdgePruned():
            ends = delta.source, delta.target
            yield MarkKind.PRUNE, f"edge {delta.source} -> {delta.target} pruned ({delta.cause.value})", ends
        case NodeDropped() if delta.cause not in BULK_CAUSES:
            yield MarkKind.PRUNE, f"node {delta.node} dropped ({delta.cause.value})", (delta.node,)
        case NodeAdded() if delta.cause in _GROWN:
            yield MarkKind.EXPAND, f"node {delta.node.id} came in ({delta.cause.value})", (delta.node.id,)
        case _:
            return
