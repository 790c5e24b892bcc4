"""Breakpoints: kinds of events at which to stop, live and in a recording, as an editable list."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ltvn_core import palette
from ltvn_core.analysis.answer import Link, Strong, joined
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.navigation.event_table import edge_text
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, request_link, time_link
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.timeline.breakpoint_monitor import Breakpoint, BreakpointMonitor
from ltvn_viz.wishes.commands import QuestionRequest

_ROWS = 12
_WORDS: Mapping[MarkKind, str] = {
    MarkKind.PRUNE: "prune",
    MarkKind.FAILURE: "failed leg",
    MarkKind.REPLAN: "replan",
    MarkKind.COLLISION: "collision",
    MarkKind.EXPAND: "expand",
    MarkKind.QUERY_START: "new query",
    MarkKind.QUERY_END: "end of a query",
}
"""The kinds of events at which a run can stop anywhere."""
_OF_EDGE = (MarkKind.PRUNE, MarkKind.FAILURE)
_OF_NODE = (MarkKind.PRUNE, MarkKind.FAILURE, MarkKind.QUERY_START)


@dataclass(frozen=True, slots=True)
class SetBreakpoint(QuestionRequest):
    """Add a breakpoint, or remove it."""

    breakpoint: Breakpoint
    is_set: bool


class BreakpointQuestion(Question[SetBreakpoint]):
    """Sets breakpoints and shows where they were met."""

    name = QuestionName.BREAK
    about = "The query or the replay stops at a kind of event that you choose, anywhere or at a node or an edge."

    def __init__(self, breakpoint_monitor: BreakpointMonitor) -> None:
        """Set the breakpoints of `breakpoint_monitor`."""
        self._monitor = breakpoint_monitor

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the breakpoints, where they were met, and other possible breakpoints."""
        builder = AnswerBuilder()
        known = self._monitor.breakpoints
        for each in known:
            builder.add_line(Strong(_text(each)), " · ", request_link("remove", SetBreakpoint(each, is_set=False)))
        if known:
            _add_stops(context, self._monitor.stops_among(context.timeline.marks), builder)
        offers = [each for each in (*_about(selection), *map(Breakpoint, _WORDS)) if each not in known]
        if offers:
            builder.add_line(
                "Stop at: ", joined(request_link(_text(each), SetBreakpoint(each, is_set=True)) for each in offers)
            )
        return builder.build(_overlay(context, known))

    def handle_request(self, context: DebugContext, request: SetBreakpoint) -> None:
        """Add or remove a breakpoint."""
        others = tuple(each for each in self._monitor.breakpoints if each != request.breakpoint)
        self._monitor.breakpoints = (*others, request.breakpoint) if request.is_set else others


def _text(breakpoint_: Breakpoint) -> str:
    words = _WORDS[breakpoint_.kind]
    match breakpoint_.ids:
        case (source, target):
            return f"{words} of {edge_text((source, target))}"
        case (node,):
            return f"{words} at node {node}"
        case _:
            return words


def _add_stops(context: DebugContext, stops: Sequence[Mark], builder: AnswerBuilder) -> None:
    before = bisect_left(stops, context.step, key=lambda stop: stop.instant.step) - 1
    after = bisect_right(stops, context.step, key=lambda stop: stop.instant.step)
    ways = [_jump(context, stops[before], "◀ previous")] if before >= 0 else []
    ways += [_jump(context, stops[after], "next ▶")] if after < len(stops) else []
    times = "once" if len(stops) == 1 else f"{len(stops)} times" if stops else "nowhere yet"
    builder.add_line("Met ", joined([Strong(times), *ways]))
    shown = stops[max(0, after - _ROWS // 2) :][:_ROWS] if not context.is_live else stops[-_ROWS:][::-1]
    builder.add_table(("when", "what"), [(_jump(context, each), each.text) for each in shown])


def _about(selection: Selection) -> Sequence[Breakpoint]:
    if selection.edge is not None:
        return [Breakpoint(kind, selection.edge) for kind in _OF_EDGE]
    return [] if selection.node is None else [Breakpoint(kind, (selection.node,)) for kind in _OF_NODE]


def _jump(context: DebugContext, stop: Mark, label: str = "") -> Link:
    return time_link(context.seconds(stop.instant), label)


def _overlay(context: DebugContext, breakpoints: Sequence[Breakpoint]) -> Overlay:
    """Draw the edges and nodes of the breakpoints."""
    edges = [pair for each in breakpoints for pair in pairwise(each.ids)]
    nodes = [each.ids[0] for each in breakpoints if len(each.ids) == 1]
    strokes = context.strokes(edges, palette.EDGE_REMOVED)
    return Overlay(strokes, dict.fromkeys(nodes, palette.EDGE_REMOVED))
