"""History: counts of marks by kind, links from each event to the next, and traces of recent changes.

Owns the texts, and the period in which pruned edges and new nodes count as recent. Marks come from
`ltvn_core.navigation.event_table`; the page's timeline moves through time.
"""

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import Inline, Key
from ltvn_core.analysis.timeline import adjacent_mark
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.graph.deltas import BULK_CAUSES, EdgeAdded, NodeAdded
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, time_link
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection, Stroke

_LAST = 3

MARK_STYLES: Mapping[MarkKind, tuple[str, Rgb8]] = {
    MarkKind.QUERY_START: ("query", palette.SOURCE),
    MarkKind.REPLAN: ("new plan", palette.PLAN),
    MarkKind.FAILURE: ("failed leg", palette.TARGET),
    MarkKind.COLLISION: ("collision", palette.TARGET),
    MarkKind.PRUNE: ("pruned", palette.EDGE_REMOVED),
    MarkKind.EXPAND: ("new node", palette.EDGE_ADDED),
}
"""Kinds of marks that are shown, from top to bottom."""
NEW_FOR_QUERIES = 2
"""Number of queries during which a node counts as new, including the query that added it."""
_GHOSTS = 200
"""Maximum number of pruned edges that are drawn, the latest ones."""
_FAINTEST = 0.25


class HistoryQuestion(Question[Never]):
    """Shows the history."""

    name = QuestionName.TIME
    about = (
        "All notable events, by kind. On the map, fading magenta edges were pruned and green nodes were added recently."
    )

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the run has any event."""
        return len(context.timeline.events) > 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Count the marks up to the moment, and offer links to others."""
        builder = AnswerBuilder()
        if not context.timeline.marks:
            builder.add_line("There are no notable events yet: build a map, or let the robot navigate.")
            return builder.build(_recent_changes(context))
        builder.add_table(("", "so far", "of all", "", ""), [_row(context, kind) for kind in MARK_STYLES])
        past = reversed(context.timeline.marks_until(context.instant))
        for mark in islice((mark for mark in past if mark.kind is not MarkKind.QUERY_END), _LAST):
            builder.add_line(time_link(context.seconds(mark.instant)), f" {mark.text}")
        return builder.build(_recent_changes(context))


def _row(context: DebugContext, kind: MarkKind) -> tuple[Inline | list[Inline], ...]:
    timeline = context.timeline
    at = context.instant
    before, after = (adjacent_mark(timeline, at, kind, forwards=forwards) for forwards in (False, True))
    name, colour = MARK_STYLES[kind]
    return (
        Key(colour, name),
        str(len(timeline.marks_until(at, kind))),
        str(len(timeline.marks_until(None, kind))),
        _way(context, before, "‹ {}"),
        _way(context, after, "{} ›"),
    )


def _way(context: DebugContext, mark: Mark | None, arrow: str) -> Inline:
    if mark is None:
        return "–"
    seconds = context.seconds(mark.instant)
    return time_link(seconds, arrow.format(f"{seconds:.1f} s"), about=mark.text)


def _recent_changes(context: DebugContext) -> Overlay:
    """Draw the recent changes up to the moment."""
    pruned = context.timeline.marks_until(context.instant, MarkKind.PRUNE)[-_GHOSTS:]
    strokes = _ghosts(context, [mark for mark in pruned if _gone(context, mark)])
    return Overlay(strokes=strokes, nodes=dict.fromkeys(_young(context), palette.EDGE_ADDED))


def _gone(context: DebugContext, mark: Mark) -> bool:
    """Tell whether a pruned element was an edge and was not added again before the moment."""
    if len(mark.ids) != 2:
        return False
    changes = context.timeline.changes_of_edge(mark.ids[0], mark.ids[1])
    later = (change for change in changes if mark.event < change.event and change.instant.step <= context.step)
    return not any(isinstance(change.delta, EdgeAdded) for change in later)


def _ghosts(context: DebugContext, pruned: Sequence[Mark]) -> tuple[Stroke, ...]:
    """Return a line for each pruned edge; older lines are fainter."""
    share = np.linspace(1 - _FAINTEST, 0.0, len(pruned)) if len(pruned) > 1 else np.zeros(len(pruned))
    colours = palette.faded(palette.EDGE_REMOVED, share, 1.0)
    marked = zip(pruned, colours.tolist(), strict=True)
    return tuple(
        line for mark, colour in marked for line in context.strokes([(mark.ids[0], mark.ids[1])], Rgb8(*colour))
    )


def _young(context: DebugContext) -> tuple[NodeId, ...]:
    """Return the nodes that were added since the second-to-last query began, except those of a map that was added at
    once."""
    starts = context.timeline.marks_until(context.instant, MarkKind.QUERY_START)[-NEW_FOR_QUERIES:]
    if not starts:
        return ()
    timeline = context.timeline
    first = timeline.change_count_before(starts[0].event)
    last = timeline.change_count_before(timeline.count_until(context.instant))
    deltas = (change.delta for change in timeline.changes[first:last])
    return tuple(delta.node.id for delta in deltas if isinstance(delta, NodeAdded) and delta.cause not in BULK_CAUSES)
