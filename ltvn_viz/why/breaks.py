"""Breakpoints: moments worth stopping at, live and in a recording, as a list to add to and to take from."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from html import escape

from ltvn_core.analysis.breakpoint_kinds import AtEdge, AtNode, Breakpoint, EdgeCondition
from ltvn_core.analysis.breakpoint_text import breakpoint_text, parse_breakpoint
from ltvn_core.errors import OptionError
from ltvn_viz import palette
from ltvn_viz.commands import Seek, Tell
from ltvn_viz.why.case import Case
from ltvn_viz.why.overlay import NOTHING, Overlay, stroke
from ltvn_viz.why.tool import Page, Selection, ToolView
from ltvn_viz.why.watch import Stop, Watch

_ROWS = 12
_OFFERED = ("prune", "failed leg", "replan", "collision", "expand", "lost", "p crosses R_p", "margin < 0.2")
_REMOVE, _ALL = "remove ", "all"


class BreakTool:
    """Sets breakpoints and shows where they were met."""

    about = "The task or the replay stops where something you name happens. Click an offer or type your own."

    def __init__(self, watch: Watch) -> None:
        """Set the breakpoints of `watch`."""
        self._watch = watch

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show the breakpoints, the neighbouring stops, and what else to stop at."""
        page = Page()
        self._breakpoints(page)
        stops = self._stops(case)
        if self._watch.breakpoints:
            self._found(case, stops, page)
        self._offers(selection, page)
        return page.view(_overlay(case, self._watch.breakpoints), asks="Stop when (edge 12->40, p(12->40) < 0.5 …)")

    def told(self, case: Case, text: str) -> None:
        """Add a breakpoint, or take one or "all" out with the word "remove" before it. Raises OptionError."""
        words, known = " ".join(text.split()), self._watch.breakpoints
        if words.startswith(_REMOVE):
            self._set(case, _without(known, words.removeprefix(_REMOVE), case))
        elif (fresh := parse_breakpoint(words, case.method.believing)) not in known:
            self._set(case, (*known, fresh))

    def _set(self, case: Case, breakpoints: Sequence[Breakpoint]) -> None:
        self._watch.change(breakpoints, case.live.events, case.live.start_s)

    def _stops(self, case: Case) -> Sequence[Stop]:
        return tuple(self._watch.stops) if case.is_live else self._watch.stops_of(case.timeline, case.start_s)

    def _breakpoints(self, page: Page) -> None:
        for each in self._watch.breakpoints:
            text = breakpoint_text(each)
            page.html(f"<div><b>{escape(text)}</b> · {page.link('remove', Tell(_REMOVE + text))}</div>")
        if len(self._watch.breakpoints) > 1:
            page.html(f"<div>{page.link('remove all', Tell(_REMOVE + _ALL))}</div>")

    def _found(self, case: Case, stops: Sequence[Stop], page: Page) -> None:
        before = bisect_left(stops, case.step, key=lambda stop: stop.hit.moment.step) - 1
        after = bisect_right(stops, case.step, key=lambda stop: stop.hit.moment.step)
        ways = [_jump(page, "◀ previous", stops[before])] if before >= 0 else []
        ways += [_jump(page, "next ▶", stops[after])] if after < len(stops) else []
        times = "once" if len(stops) == 1 else f"{len(stops)} times" if stops else "nowhere yet"
        page.html(f"<div>Met <b>{times}</b>{' · ' if ways else ''}{' · '.join(ways)}</div>")
        shown = stops[max(0, after - _ROWS // 2) :][:_ROWS] if not case.is_live else stops[-_ROWS:][::-1]
        if shown:
            page.table(("when", "what"), [(_jump(page, f"{each.time_s:.1f} s", each), _why(each)) for each in shown])

    def _offers(self, selection: Selection, page: Page) -> None:
        known = {breakpoint_text(each) for each in self._watch.breakpoints}
        offers = [text for text in (*_about(selection), *_OFFERED) if text not in known]
        links = " · ".join(page.link(text, Tell(text)) for text in offers)
        page.html(f"<div>Stop at: {links}</div>")


def _without(known: Sequence[Breakpoint], text: str, case: Case) -> tuple[Breakpoint, ...]:
    if text == _ALL:
        return ()
    gone = parse_breakpoint(text, case.method.believing)
    if gone not in known:
        listed = ", ".join(breakpoint_text(each) for each in known) or "none"
        raise OptionError(f"{text!r} is not among the breakpoints; there are: {listed}.")
    return tuple(each for each in known if each != gone)


def _about(selection: Selection) -> tuple[str, ...]:
    if selection.edge is not None:
        edge = f"{selection.edge[0]}->{selection.edge[1]}"
        return f"edge {edge}", f"p({edge}) < 0.5"
    return () if selection.node is None else (f"node {selection.node}",)


def _why(stop: Stop) -> str:
    return escape(stop.hit.why)


def _jump(page: Page, label: str, stop: Stop) -> str:
    return page.link(label, Seek(stop.time_s))


def _overlay(case: Case, breakpoints: Sequence[Breakpoint]) -> Overlay:
    """Draw the edges and nodes that breakpoints are about."""
    edges = [each.edge for each in breakpoints if isinstance(each, AtEdge | EdgeCondition)]
    nodes = [each.node for each in breakpoints if isinstance(each, AtNode)]
    ends = [(case.pose(source), case.pose(target)) for source, target in edges]
    strokes = tuple(stroke(start, end, palette.WENT) for start, end in ends if start is not None and end is not None)
    return Overlay(strokes, dict.fromkeys(nodes, palette.WENT)) if strokes or nodes else NOTHING
