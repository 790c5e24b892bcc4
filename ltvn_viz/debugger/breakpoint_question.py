"""Breakpoints: moments worth stopping at, live and in a recording, as a list to add to and to take from."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from html import escape

from ltvn_core import palette
from ltvn_core.analysis.breakpoint_kinds import Breakpoint, EdgeBeliefBreakpoint, EdgeBreakpoint, NodeBreakpoint
from ltvn_core.analysis.breakpoint_parser import format_breakpoint, parse_breakpoint
from ltvn_core.errors import OptionError
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.session.commands import Seek, SubmitText
from ltvn_viz.session.inspection import QuestionAnswer, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, stroke
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor, BreakpointStop

_ROWS = 12
_OFFERED = ("prune", "failed leg", "replan", "collision", "expand", "lost", "p crosses R_p", "margin < 0.2")
_REMOVE, _ALL = "remove ", "all"


class BreakpointQuestion:
    """Sets breakpoints and shows where they were met."""

    about = "The task or the replay stops where something you name happens. Click an offer or type your own."

    def __init__(self, breakpoint_monitor: BreakpointMonitor) -> None:
        """Set the breakpoints of `breakpoint_monitor`."""
        self._monitor = breakpoint_monitor

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the breakpoints, the neighbouring stops, and what else to stop at."""
        builder = AnswerBuilder()
        self._breakpoints(builder)
        stops = self._stops(context)
        if self._monitor.breakpoints:
            self._found(context, stops, builder)
        self._offers(selection, builder)
        return builder.build(
            _overlay(context, self._monitor.breakpoints), input_hint="Stop when (edge 12->40, p(12->40) < 0.5 …)"
        )

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Add a breakpoint, or take one or "all" out with the word "remove" before it. Raises OptionError."""
        words, known = " ".join(text.split()), self._monitor.breakpoints
        if words.startswith(_REMOVE):
            self._set(context, _without(known, words.removeprefix(_REMOVE), context))
        elif (fresh := parse_breakpoint(words, context.method.believing)) not in known:
            self._set(context, (*known, fresh))

    def _set(self, context: DebugContext, breakpoints: Sequence[Breakpoint]) -> None:
        self._monitor.change(breakpoints, context.live)

    def _stops(self, context: DebugContext) -> Sequence[BreakpointStop]:
        return tuple(self._monitor.stops) if context.is_live else self._monitor.stops_of(context.timeline)

    def _breakpoints(self, builder: AnswerBuilder) -> None:
        for each in self._monitor.breakpoints:
            text = format_breakpoint(each)
            builder.add_html(f"<div><b>{escape(text)}</b> · {builder.link('remove', SubmitText(_REMOVE + text))}</div>")
        if len(self._monitor.breakpoints) > 1:
            builder.add_html(f"<div>{builder.link('remove all', SubmitText(_REMOVE + _ALL))}</div>")

    def _found(self, context: DebugContext, stops: Sequence[BreakpointStop], builder: AnswerBuilder) -> None:
        before = bisect_left(stops, context.step, key=lambda stop: stop.hit.moment.step) - 1
        after = bisect_right(stops, context.step, key=lambda stop: stop.hit.moment.step)
        ways = [_jump(builder, "◀ previous", stops[before])] if before >= 0 else []
        ways += [_jump(builder, "next ▶", stops[after])] if after < len(stops) else []
        times = "once" if len(stops) == 1 else f"{len(stops)} times" if stops else "nowhere yet"
        builder.add_html(f"<div>Met <b>{times}</b>{' · ' if ways else ''}{' · '.join(ways)}</div>")
        shown = stops[max(0, after - _ROWS // 2) :][:_ROWS] if not context.is_live else stops[-_ROWS:][::-1]
        if shown:
            builder.add_table(
                ("when", "what"), [(_jump(builder, f"{each.time_s:.1f} s", each), _why(each)) for each in shown]
            )

    def _offers(self, selection: Selection, builder: AnswerBuilder) -> None:
        known = {format_breakpoint(each) for each in self._monitor.breakpoints}
        offers = [text for text in (*_about(selection), *_OFFERED) if text not in known]
        links = " · ".join(builder.link(text, SubmitText(text)) for text in offers)
        builder.add_html(f"<div>Stop at: {links}</div>")


def _without(known: Sequence[Breakpoint], text: str, context: DebugContext) -> tuple[Breakpoint, ...]:
    if text == _ALL:
        return ()
    gone = parse_breakpoint(text, context.method.believing)
    if gone not in known:
        listed = ", ".join(format_breakpoint(each) for each in known) or "none"
        raise OptionError(f"{text!r} is not among the breakpoints; there are: {listed}.")
    return tuple(each for each in known if each != gone)


def _about(selection: Selection) -> tuple[str, ...]:
    if selection.edge is not None:
        edge = f"{selection.edge[0]}->{selection.edge[1]}"
        return f"edge {edge}", f"p({edge}) < 0.5"
    return () if selection.node is None else (f"node {selection.node}",)


def _why(stop: BreakpointStop) -> str:
    return escape(stop.hit.why)


def _jump(builder: AnswerBuilder, label: str, stop: BreakpointStop) -> str:
    return builder.link(label, Seek(stop.time_s))


def _overlay(context: DebugContext, breakpoints: Sequence[Breakpoint]) -> Overlay:
    """Draw the edges and nodes that breakpoints are about."""
    edges = [each.edge for each in breakpoints if isinstance(each, EdgeBreakpoint | EdgeBeliefBreakpoint)]
    nodes = [each.node for each in breakpoints if isinstance(each, NodeBreakpoint)]
    ends = [(context.pose(source), context.pose(target)) for source, target in edges]
    strokes = tuple(
        stroke(start, end, palette.EDGE_REMOVED) for start, end in ends if start is not None and end is not None
    )
    return Overlay(strokes, dict.fromkeys(nodes, palette.EDGE_REMOVED)) if strokes or nodes else EMPTY_OVERLAY
