"""Breakpoints: moments at which to stop, live and in a recording, as an editable list."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, assert_never

from ltvn_core import palette
from ltvn_core.analysis.answer import Link, Strong, joined
from ltvn_core.analysis.breakpoints import (
    Breakpoint,
    BreakpointQuantity,
    BreakpointTrigger,
    EdgeBeliefBreakpoint,
    EdgeBreakpoint,
    EventBreakpoint,
    LocalisationBreakpoint,
    NodeBreakpoint,
    format_breakpoint,
    parse_breakpoint,
    prune_threshold_breakpoint,
)
from ltvn_core.errors import OptionError
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, request_link, time_link
from ltvn_viz.session.inspection import EMPTY_OVERLAY, Overlay, QuestionAnswer, QuestionName, Selection, stroke
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor, BreakpointStop
from ltvn_viz.wishes.commands import QuestionRequest

_ROWS = 12
_OFFERED_TRIGGERS = (
    BreakpointTrigger.PRUNE,
    BreakpointTrigger.FAILED_ATTEMPT,
    BreakpointTrigger.REPLAN,
    BreakpointTrigger.COLLISION,
    BreakpointTrigger.EXPANSION,
    BreakpointTrigger.LOST,
)
_SMALL_MARGIN = LocalisationBreakpoint(BreakpointQuantity.MARGIN, less=True, value=0.2)
_REMOVE = "remove "
_ALL = "all"


@dataclass(frozen=True, slots=True)
class AddBreakpoint(QuestionRequest):
    """Add a breakpoint."""

    breakpoint: Breakpoint


@dataclass(frozen=True, slots=True)
class RemoveBreakpoint(QuestionRequest):
    """Remove a breakpoint."""

    breakpoint: Breakpoint


@dataclass(frozen=True, slots=True)
class RemoveAllBreakpoints(QuestionRequest):
    """Remove all breakpoints."""


BreakpointRequest: TypeAlias = AddBreakpoint | RemoveBreakpoint | RemoveAllBreakpoints


class BreakpointQuestion(Question[BreakpointRequest]):
    """Sets breakpoints and shows where they were met."""

    name = QuestionName.BREAK
    word = QuestionName.BREAK.word
    verb = "Stop there"
    about = "The query or the replay stops at an event that you choose. Choose a suggestion or type your own."

    def __init__(self, breakpoint_monitor: BreakpointMonitor) -> None:
        """Set the breakpoints of `breakpoint_monitor`."""
        self._monitor = breakpoint_monitor

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the breakpoints, the neighbouring stops, and other possible breakpoints."""
        builder = AnswerBuilder()
        self._breakpoints(builder)
        stops = self._stops(context)
        if self._monitor.breakpoints:
            self._found(context, stops, builder)
        self._offers(context, selection, builder)
        return builder.build(
            _overlay(context, self._monitor.breakpoints), input_hint="Stop when (edge 12->40, p(12->40) < 0.5 …)"
        )

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Add a breakpoint, or remove one or "all" of them if the text starts with "remove". Raises OptionError."""
        self.handle_request(context, _typed_request(text, context))

    def handle_request(self, context: DebugContext, request: BreakpointRequest) -> None:
        """Add or remove breakpoints. Raises OptionError if the breakpoint to remove is not set."""
        known = self._monitor.breakpoints
        match request:
            case AddBreakpoint(fresh):
                if fresh not in known:
                    self._set(context, (*known, fresh))
            case RemoveBreakpoint(gone):
                self._set(context, _without(known, gone))
            case RemoveAllBreakpoints():
                self._set(context, ())
            case _:
                assert_never(request)

    def _set(self, context: DebugContext, breakpoints: Sequence[Breakpoint]) -> None:
        self._monitor.change(breakpoints, context.live)

    def _stops(self, context: DebugContext) -> Sequence[BreakpointStop]:
        return tuple(self._monitor.stops) if context.is_live else self._monitor.stops_of(context.timeline)

    def _breakpoints(self, builder: AnswerBuilder) -> None:
        for each in self._monitor.breakpoints:
            builder.add_line(Strong(format_breakpoint(each)), " · ", request_link("remove", RemoveBreakpoint(each)))
        if len(self._monitor.breakpoints) > 1:
            builder.add_line(request_link("remove all", RemoveAllBreakpoints()))

    def _found(self, context: DebugContext, stops: Sequence[BreakpointStop], builder: AnswerBuilder) -> None:
        before = bisect_left(stops, context.step, key=lambda stop: stop.hit.moment.step) - 1
        after = bisect_right(stops, context.step, key=lambda stop: stop.hit.moment.step)
        ways = [_jump(stops[before], "◀ previous")] if before >= 0 else []
        ways += [_jump(stops[after], "next ▶")] if after < len(stops) else []
        times = "once" if len(stops) == 1 else f"{len(stops)} times" if stops else "nowhere yet"
        builder.add_line("Met ", joined([Strong(times), *ways]))
        shown = stops[max(0, after - _ROWS // 2) :][:_ROWS] if not context.is_live else stops[-_ROWS:][::-1]
        if shown:
            builder.add_table(("when", "what"), [(_jump(each), each.hit.why) for each in shown])

    def _offers(self, context: DebugContext, selection: Selection, builder: AnswerBuilder) -> None:
        offers = [*_about(selection), *map(EventBreakpoint, _OFFERED_TRIGGERS)]
        offers += [prune_threshold_breakpoint(context.method.believing), _SMALL_MARGIN]
        fresh = [each for each in offers if each not in self._monitor.breakpoints]
        links = [request_link(format_breakpoint(each), AddBreakpoint(each)) for each in fresh]
        builder.add_line("Stop at: ", joined(links))


def _typed_request(text: str, context: DebugContext) -> BreakpointRequest:
    words = " ".join(text.split())
    believing = context.method.believing
    if not words.startswith(_REMOVE):
        return AddBreakpoint(parse_breakpoint(words, believing))
    named = words.removeprefix(_REMOVE)
    return RemoveAllBreakpoints() if named == _ALL else RemoveBreakpoint(parse_breakpoint(named, believing))


def _without(known: Sequence[Breakpoint], gone: Breakpoint) -> tuple[Breakpoint, ...]:
    if gone not in known:
        listed = ", ".join(format_breakpoint(each) for each in known) or "none"
        raise OptionError(f"{format_breakpoint(gone)!r} is not among the breakpoints; there are: {listed}.")
    return tuple(each for each in known if each != gone)


def _about(selection: Selection) -> tuple[Breakpoint, ...]:
    if selection.edge is not None:
        doubtful = EdgeBeliefBreakpoint(BreakpointQuantity.P, selection.edge, less=True, value=0.5)
        return EdgeBreakpoint(selection.edge), doubtful
    return () if selection.node is None else (NodeBreakpoint(selection.node),)


def _jump(stop: BreakpointStop, label: str = "") -> Link:
    return time_link(stop.time_s, label)


def _overlay(context: DebugContext, breakpoints: Sequence[Breakpoint]) -> Overlay:
    """Draw the edges and nodes of the breakpoints."""
    edges = [each.edge for each in breakpoints if isinstance(each, EdgeBreakpoint | EdgeBeliefBreakpoint)]
    nodes = [each.node for each in breakpoints if isinstance(each, NodeBreakpoint)]
    ends = [(context.pose(source), context.pose(target)) for source, target in edges]
    strokes = tuple(
        stroke(start, end, palette.EDGE_REMOVED) for start, end in ends if start is not None and end is not None
    )
    return Overlay(strokes, dict.fromkeys(nodes, palette.EDGE_REMOVED)) if strokes or nodes else EMPTY_OVERLAY
