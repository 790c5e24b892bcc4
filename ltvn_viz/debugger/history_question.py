"""What happened when: counts and a strip of marks by kind, the way from each to the next, and traces of what changed.

Owns the words, and what counts as lately: where edges were pruned and which nodes are new. What gets a mark is
`ltvn_core.analysis.timeline_rows`; one moves through time by the page's timeline.
"""

from collections.abc import Mapping, Sequence
from html import escape
from itertools import islice
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.graph.deltas import BULK_CAUSES, EdgeAdded, NodeAdded
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.server.keymap import Action, key_label
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, Stroke, stroke
from ltvn_viz.timeline.adjacent_moments import adjacent_mark

_LAST = 3
_KEYS = (
    f"Keys: {key_label(Action.EVENT_BEFORE)} and {key_label(Action.EVENT_AFTER)} go from event to event, "
    f"{key_label(Action.QUERY_BEFORE)} and {key_label(Action.QUERY_AFTER)} from query to query."
)

MARK_STYLES: Mapping[MarkKind, tuple[str, Rgb8]] = {
    MarkKind.QUERY_START: ("query", palette.SOURCE),
    MarkKind.REPLAN: ("new plan", palette.PLAN),
    MarkKind.FAILURE: ("failed leg", palette.TARGET),
    MarkKind.COLLISION: ("collision", palette.GOAL),
    MarkKind.PRUNE: ("pruned", palette.EDGE_REMOVED),
    MarkKind.EXPAND: ("new node", palette.EDGE_ADDED),
}
"""The kinds that are shown, from top to bottom."""
_WIDTH_PX, _ROW_PX = 340, 9
NEW_FOR_QUERIES = 2
"""A node is new during the query that brought it and the next."""
_GHOSTS = 200
"""More pruned edges than this are a tangle; the latest are drawn."""
_FAINTEST = 0.25


class HistoryQuestion(Question[Never]):
    """Tells the history."""

    name = QuestionName.TIME
    word = QuestionName.TIME.word
    is_for_watchers = True
    about = "All that is notable, by kind. In the scene: fading magenta edges were pruned, green nodes came in lately."

    def __init__(self) -> None:
        """Begin with nothing drawn."""
        self._recent_changes = RecentChanges()

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether anything happened."""
        return len(context.timeline.events) > 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Count marks until the moment, and offer ways to others."""
        builder = AnswerBuilder()
        if not context.timeline.marks:
            builder.add_text("Nothing notable happened yet: build a map, or let the robot navigate.")
            return builder.build(self._recent_changes.at(context))
        builder.add_table(("", "so far", "of all", "", ""), [_row(context, kind, builder) for kind in MARK_STYLES])
        builder.add_html(_mark_timeline_svg(context))
        past = reversed(context.timeline.marks_until(context.instant))
        for mark in islice((mark for mark in past if mark.kind is not MarkKind.QUERY_END), _LAST):
            builder.add_html(f"<div>{builder.time_link(context.seconds(mark.instant))} {escape(mark.text)}</div>")
        builder.add_text(_KEYS)
        return builder.build(self._recent_changes.at(context))


def _row(context: DebugContext, kind: MarkKind, builder: AnswerBuilder) -> tuple[str, ...]:
    timeline, at = context.timeline, context.instant
    before, after = (adjacent_mark(timeline, at, kind, forwards=forwards) for forwards in (False, True))
    name, colour = MARK_STYLES[kind]
    counts = len(timeline.marks_until(at, kind)), len(timeline.marks_until(None, kind))
    chip = f'<span style="color:{colour.css}">■</span> {escape(name)}'
    return (
        chip,
        str(counts[0]),
        str(counts[1]),
        _way(context, before, "‹ {}", builder),
        _way(context, after, "{} ›", builder),
    )


def _way(context: DebugContext, mark: Mark | None, arrow: str, builder: AnswerBuilder) -> str:
    if mark is None:
        return "–"
    seconds = context.seconds(mark.instant)
    return f'<span title="{escape(mark.text)}">{builder.time_link(seconds, arrow.format(f"{seconds:.1f} s"))}</span>'


def _mark_timeline_svg(context: DebugContext) -> str:
    """Return the strip of all marks that are known, with a line at the moment; as large as it is wide at most."""
    timeline = context.timeline
    until = max(timeline.instant(len(timeline.events) - 1).stamp, context.moment.stamp)
    span = max(until - context.start_s, 1e-9)
    rows = "".join(
        _strip_row(timeline.marks_until(None, kind), name, colour, row, context.start_s, span)
        for row, (kind, (name, colour)) in enumerate(MARK_STYLES.items())
    )
    now, height = _strip_column(context.moment.stamp, context.start_s, span), _ROW_PX * len(MARK_STYLES)
    line = f'<path d="M{now} 0v{height}" stroke="rgb(255,255,255)" stroke-width="1.5"/>'
    size = f'viewBox="0 0 {_WIDTH_PX} {height}"'
    return f'<svg {size} role="img" aria-label="marks over time" class="lt-curve">{rows}{line}</svg>'


def _strip_row(marks: Sequence[Mark], name: str, colour: Rgb8, row: int, start_s: float, span: float) -> str:
    # However many marks there are, there are no more columns than this.
    columns = sorted({_strip_column(mark.instant.stamp, start_s, span) for mark in marks})
    ticks = "".join(f"M{column} {row * _ROW_PX + 1}v{_ROW_PX - 2}" for column in columns)
    title = f"<title>{escape(name)}: {len(marks)}</title>"
    return f'<path d="{ticks}" stroke="{colour.css}" stroke-width="2">{title}</path>' if ticks else ""


def _strip_column(stamp: float, start_s: float, span: float) -> int:
    share = min(max((stamp - start_s) / span, 0.0), 1.0)
    return round(2 + share * (_WIDTH_PX - 4))


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
