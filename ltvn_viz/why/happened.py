"""What happened when: counts and a strip of marks by kind, the way from each to the next, and traces of what changed.

Owns the words. What gets a mark is `ltvn_core.analysis.marks`; the slider over the time is in the Replay tab.
"""

from html import escape
from itertools import islice

from ltvn_core.analysis.records import Mark, MarkKind
from ltvn_core.errors import OptionError
from ltvn_viz.keymap import Action, caps_for
from ltvn_viz.why.case import Case
from ltvn_viz.why.stepping import neighbour_mark
from ltvn_viz.why.strip import KINDS, marks_strip
from ltvn_viz.why.tool import Page, Selection, ToolView
from ltvn_viz.why.traces import Traces

_LAST = 3
_KEYS = (
    f"Keys: {caps_for(Action.EVENT_BEFORE)} and {caps_for(Action.EVENT_AFTER)} go from event to event, "
    f"{caps_for(Action.QUERY_BEFORE)} and {caps_for(Action.QUERY_AFTER)} from query to query."
)


class HappenedTool:
    """Tells the history."""

    about = "All that is notable, by kind. In the scene: faded red edges were pruned, green nodes came in lately."

    def __init__(self) -> None:
        """Begin with nothing drawn."""
        self._traces = Traces()

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Count marks until the moment, and offer ways to others."""
        page = Page()
        if not case.timeline.marks:
            page.line("Nothing notable happened yet: build a map, or let the robot navigate.")
            return page.view(self._traces.at(case))
        page.table(("", "so far", "of all", "", ""), [_row(case, kind, page) for kind in KINDS])
        page.html(marks_strip(case))
        past = reversed(case.timeline.marks_until(case.instant))
        for mark in islice((mark for mark in past if mark.kind is not MarkKind.QUERY_END), _LAST):
            page.html(f"<div>{page.jump(case.seconds(mark.instant))} {escape(mark.text)}</div>")
        page.line(_KEYS)
        return page.view(self._traces.at(case))

    def told(self, case: Case, text: str) -> None:
        """Take nothing in."""
        raise OptionError("Nothing is asked here; follow a link to a moment.")


def _row(case: Case, kind: MarkKind, page: Page) -> tuple[str, ...]:
    timeline, at = case.timeline, case.instant
    before, after = (neighbour_mark(timeline, at, kind, forwards=forwards) for forwards in (False, True))
    name, colour = KINDS[kind]
    counts = len(timeline.marks_until(at, kind)), len(timeline.marks_until(None, kind))
    chip = f'<span style="color:{colour.css}">■</span> {escape(name)}'
    return chip, str(counts[0]), str(counts[1]), _way(case, before, "‹ {}", page), _way(case, after, "{} ›", page)


def _way(case: Case, mark: Mark | None, arrow: str, page: Page) -> str:
    if mark is None:
        return "–"
    seconds = case.seconds(mark.instant)
    return f'<span title="{escape(mark.text)}">{page.jump(seconds, arrow.format(f"{seconds:.1f} s"))}</span>'
