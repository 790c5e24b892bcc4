"""What happened when: counts and a strip of marks by kind, the way from each to the next, and traces of what changed.

Owns the words. What gets a mark is `ltvn_core.analysis.timeline_marks`; the slider over the time is in the Replay tab.
"""

from html import escape
from itertools import islice

from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.errors import OptionError
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, QuestionAnswer, Selection
from ltvn_viz.debugger.recent_changes import RecentChanges
from ltvn_viz.debugger.timeline_strip import MARK_STYLES, mark_timeline_svg
from ltvn_viz.server.keymap import Action, key_label
from ltvn_viz.timeline.adjacent_moments import adjacent_mark

_LAST = 3
_KEYS = (
    f"Keys: {key_label(Action.EVENT_BEFORE)} and {key_label(Action.EVENT_AFTER)} go from event to event, "
    f"{key_label(Action.QUERY_BEFORE)} and {key_label(Action.QUERY_AFTER)} from query to query."
)


class HistoryQuestion:
    """Tells the history."""

    about = "All that is notable, by kind. In the scene: faded red edges were pruned, green nodes came in lately."

    def __init__(self) -> None:
        """Begin with nothing drawn."""
        self._recent_changes = RecentChanges()

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Count marks until the moment, and offer ways to others."""
        builder = AnswerBuilder()
        if not context.timeline.marks:
            builder.add_text("Nothing notable happened yet: build a map, or let the robot navigate.")
            return builder.build(self._recent_changes.at(context))
        builder.add_table(("", "so far", "of all", "", ""), [_row(context, kind, builder) for kind in MARK_STYLES])
        builder.add_html(mark_timeline_svg(context))
        past = reversed(context.timeline.marks_until(context.instant))
        for mark in islice((mark for mark in past if mark.kind is not MarkKind.QUERY_END), _LAST):
            builder.add_html(f"<div>{builder.time_link(context.seconds(mark.instant))} {escape(mark.text)}</div>")
        builder.add_text(_KEYS)
        return builder.build(self._recent_changes.at(context))

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Take nothing in."""
        raise OptionError("Nothing is asked here; follow a link to a moment.")


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
