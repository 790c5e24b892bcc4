"""Traces of time in the scene: where edges were pruned, and which nodes are new.

Owns what counts as lately. Its drawing stays the same object as long as nothing changed.
"""

from collections.abc import Sequence

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.graph.deltas import BULK_CAUSES, EdgeAdded, NodeAdded
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, Stroke, stroke

NEW_FOR_QUERIES = 2
"""A node is new during the query that brought it and the next."""
_GHOSTS = 200
"""More pruned edges than this are a tangle; the latest are drawn."""
_FAINTEST = 0.25


class RecentChanges:
    """Remembers what was drawn last."""

    def __init__(self) -> None:
        """Begin with nothing drawn."""
        self._key: object = None
        self._drawn = EMPTY_OVERLAY

    def at(self, context: DebugContext) -> Overlay:
        """Return the traces of everything up to the case's moment."""
        pruned = [
            mark
            for mark in context.timeline.marks_until(context.instant, MarkKind.PRUNE)[-_GHOSTS:]
            if _gone(context, mark)
        ]
        young = _young(context)
        key = context.name, context.start_s, tuple(mark.event for mark in pruned), young
        if key != self._key:
            strokes = _ghosts(context, pruned)
            self._key, self._drawn = key, Overlay(strokes=strokes, nodes=dict.fromkeys(young, palette.EDGE_ADDED))
        return self._drawn


def _gone(context: DebugContext, mark: Mark) -> bool:
    """Tell whether it was an edge, and has not come back until the moment."""
    if len(mark.ids) != 2:
        return False
    changes = context.timeline.changes_of_edge(mark.ids[0], mark.ids[1])
    later = (change for change in changes if mark.event < change.event and change.instant.step <= context.step)
    return not any(isinstance(change.delta, EdgeAdded) for change in later)


def _ghosts(context: DebugContext, pruned: Sequence[Mark]) -> tuple[Stroke, ...]:
    """Return a line for each pruned edge, the older the fainter."""
    share = np.linspace(1 - _FAINTEST, 0.0, len(pruned)) if len(pruned) > 1 else np.zeros(len(pruned))
    colours = palette.faded(palette.EDGE_REMOVED, share, 1.0)
    strokes = []
    for mark, colour in zip(pruned, colours.tolist(), strict=True):
        start, end = context.pose(mark.ids[0]), context.pose(mark.ids[1])
        if start is not None and end is not None:
            strokes.append(stroke(start, end, Rgb8(*colour)))
    return tuple(strokes)


def _young(context: DebugContext) -> tuple[NodeId, ...]:
    """Return the nodes that came in, not with a whole map, since the query before the latest began."""
    starts = context.timeline.marks_until(context.instant, MarkKind.QUERY_START)[-NEW_FOR_QUERIES:]
    if not starts:
        return ()
    timeline = context.timeline
    first = timeline.change_count_before(starts[0].event)
    last = timeline.change_count_before(timeline.count_until(context.instant))
    deltas = (change.delta for change in timeline.changes[first:last])
    return tuple(delta.node.id for delta in deltas if isinstance(delta, NodeAdded) and delta.cause not in BULK_CAUSES)
