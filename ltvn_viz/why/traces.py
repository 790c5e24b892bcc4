"""Traces of time in the scene: where edges were pruned, and which nodes are new.

Owns what counts as lately. Its drawing stays the same object as long as nothing changed.
"""

from collections.abc import Sequence

import numpy as np

from ltvn_core.analysis.records import Mark, MarkKind
from ltvn_core.graph.deltas import WHOLE_MAP, EdgeAdded, NodeAdded
from ltvn_core.types import NodeId
from ltvn_viz import palette
from ltvn_viz.palette import Rgb8
from ltvn_viz.why.case import Case
from ltvn_viz.why.overlay import NOTHING, Overlay, Stroke, stroke

QUERIES = 2
"""A node is new during the query that brought it and the next."""
_GHOSTS = 200
"""More pruned edges than this are a tangle; the latest are drawn."""
_FAINTEST = 0.25


class Traces:
    """Remembers what was drawn last."""

    def __init__(self) -> None:
        """Begin with nothing drawn."""
        self._key: object = None
        self._drawn = NOTHING

    def at(self, case: Case) -> Overlay:
        """Return the traces of everything up to the case's moment."""
        pruned = [
            mark for mark in case.timeline.marks_until(case.instant, MarkKind.PRUNE)[-_GHOSTS:] if _gone(case, mark)
        ]
        young = _young(case)
        key = case.name, case.start_s, tuple(mark.event for mark in pruned), young
        if key != self._key:
            strokes = _ghosts(case, pruned)
            self._key, self._drawn = key, Overlay(strokes=strokes, nodes=dict.fromkeys(young, palette.CAME))
        return self._drawn


def _gone(case: Case, mark: Mark) -> bool:
    """Tell whether it was an edge, and has not come back until the moment."""
    if len(mark.ids) != 2:
        return False
    changes = case.timeline.changes_of_edge(mark.ids[0], mark.ids[1])
    later = (change for change in changes if mark.event < change.event and change.instant.step <= case.step)
    return not any(isinstance(change.delta, EdgeAdded) for change in later)


def _ghosts(case: Case, pruned: Sequence[Mark]) -> tuple[Stroke, ...]:
    """Return a line for each pruned edge, the older the fainter."""
    share = np.linspace(1 - _FAINTEST, 0.0, len(pruned)) if len(pruned) > 1 else np.zeros(len(pruned))
    colours = palette.faded(palette.WENT, share, 1.0)
    strokes = []
    for mark, colour in zip(pruned, colours.tolist(), strict=True):
        start, end = case.pose(mark.ids[0]), case.pose(mark.ids[1])
        if start is not None and end is not None:
            strokes.append(stroke(start, end, Rgb8(*colour)))
    return tuple(strokes)


def _young(case: Case) -> tuple[NodeId, ...]:
    """Return the nodes that came in, not with a whole map, since the query before the latest began."""
    starts = case.timeline.marks_until(case.instant, MarkKind.QUERY_START)[-QUERIES:]
    if not starts:
        return ()
    timeline = case.timeline
    first, last = len(timeline.changes_before(starts[0].event)), len(timeline.changes_until(case.instant))
    deltas = (change.delta for change in timeline.changes[first:last])
    return tuple(delta.node.id for delta in deltas if isinstance(delta, NodeAdded) and delta.cause not in WHOLE_MAP)
