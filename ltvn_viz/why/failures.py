"""What failed: queries by cause and place, the second before each went wrong, and success over the robot's life.

Owns the page of it. Causes and places are found in `ltvn_core.analysis.triage`, the curves are `why.lifelong`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from ltvn_core.analysis.records import Query
from ltvn_core.analysis.strip import LifelongStrip, lifelong_strip
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.triage import FailedQuery, Place, Trouble, by_place, by_trouble, failed_queries
from ltvn_core.errors import OptionError
from ltvn_core.graph.topograph import EdgeKey
from ltvn_viz import palette
from ltvn_viz.commands import ChooseTool, PointAt, Tell
from ltvn_viz.why.case import Case
from ltvn_viz.why.lifelong import show_life
from ltvn_viz.why.overlay import NOTHING, Label, Overlay, stroke
from ltvn_viz.why.tool import Page, Selection, ToolName, ToolView

_NEXT = {
    Trouble.WRONG_ARRIVAL: (ToolName.EDGE, ToolName.WHERE),
    Trouble.LOST: (ToolName.WHERE, ToolName.BLAME),
    Trouble.NO_PATH: (ToolName.TRUTH, ToolName.WHAT_IF),
    Trouble.COLLISION: (ToolName.BLAME, ToolName.EDGE),
    Trouble.FAILED_EDGE: (ToolName.BLAME, ToolName.EDGE),
    Trouble.TOO_SLOW: (ToolName.BLAME, ToolName.EDGE),
}
"""What to ask next."""
WINDOW = 10
"""Queries over which success is counted."""
_ROWS = 10
_ALL = "all"


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What there is to know about a run's queries."""

    failures: tuple[FailedQuery, ...]
    places: tuple[Place, ...]
    strip: LifelongStrip

    @classmethod
    def of(cls, timeline: Timeline) -> "Findings":
        """Look through a run; linear in its events."""
        failures = failed_queries(timeline)
        return cls(failures, by_place(failures), lifelong_strip(timeline, WINDOW))


class FailuresTool:
    """Tells what failed."""

    about = "Failed queries by cause and place; a time leads to the second before it went wrong."

    def __init__(self) -> None:
        """Begin with all causes."""
        self._only: Trouble | None = None
        self._known: tuple[object, Findings | None] = (None, None)
        self._drawn: tuple[object, Overlay] = (None, NOTHING)

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show the failures of the whole run, and the one at the moment."""
        page, findings = Page(), self._findings(case)
        if findings is None:
            page.line("Looking through the queries …")
            return page.view()
        if not len(findings.strip.queries):
            page.line("No query has ended yet: choose a goal under “Go”, or open a recording with queries.")
            return page.view()
        shown = [each for each in findings.failures if self._only in (None, each.trouble)]
        self._causes(findings, page)
        now = next((each for each in shown if _covers(each, case)), None)
        if now is not None:
            _detail(case, now, page)
        if shown:
            page.table(("when", "query", "cause", "near node"), [_row(case, each, page) for each in shown[-_ROWS:]])
        if len(shown) > _ROWS:
            page.line(f"The last {_ROWS} of {len(shown)}; choose a cause above to see others.")
        show_life(case, findings.strip, page)
        return page.view(self._overlay(case, findings, shown, now))

    def told(self, case: Case, text: str) -> None:
        """Show one cause, or all."""
        if text != _ALL and text not in [*Trouble]:
            raise OptionError(f"Choose a cause out of {', '.join(Trouble)}, or {_ALL}.")
        self._only = None if text == _ALL else Trouble(text)

    def _findings(self, case: Case) -> Findings | None:
        queries, timeline = case.timeline.queries, case.timeline
        last = (queries[-1].ended, queries[-1].judged) if queries else None
        # A run that goes on is looked through again when a query is over, not with every event.
        run = case.name, case.start_s
        answer = case.later(("failures", *run, len(queries), last), lambda: Findings.of(timeline))
        if answer is not None:
            self._known = run, answer
        return self._known[1] if self._known[0] == run else None

    def _causes(self, findings: Findings, page: Page) -> None:
        count, failed = len(findings.strip.queries), len(findings.failures)
        page.html(f"<div><b>{failed}</b> of <b>{count}</b> queries failed.</div>")
        groups = by_trouble(findings.failures)
        links = [page.link(f"{trouble} {len(group)}", Tell(trouble)) for trouble, group in groups.items()]
        if self._only is not None:
            links.append(page.link("show all", Tell(_ALL)))
        if links:
            page.html(f"<div>{' · '.join(links)}</div>")

    def _overlay(
        self, case: Case, findings: Findings, shown: Sequence[FailedQuery], now: FailedQuery | None
    ) -> Overlay:
        key = findings, self._only, now
        if key != self._drawn[0]:
            self._drawn = key, _drawing(case, findings.places, shown, now)
        return self._drawn[1]


def _covers(failure: FailedQuery, case: Case) -> bool:
    """Tell whether the moment lies in a failed query."""
    end = failure.query.end or failure.query.begin
    return failure.query.begin.step <= case.step <= end.step


def _row(case: Case, failure: FailedQuery, page: Page) -> tuple[str, ...]:
    when = page.jump(case.seconds(failure.instant))
    node = "–" if failure.node is None else page.link(str(failure.node), PointAt(failure.node))
    return when, str(failure.query.id), f'<span title="{escape(failure.text)}">{failure.trouble}</span>', node


def _detail(case: Case, failure: FailedQuery, page: Page) -> None:
    query = failure.query
    wrong = page.jump(case.seconds(case.timeline.instant(failure.event)))
    began = page.jump(case.seconds(query.begin), "its beginning")
    page.html(f"<div>Now in <b>query {query.id}</b> to node {query.goal} ({began}): {failure.trouble}.</div>")
    page.html(f"<div>{wrong} {escape(failure.text)}</div>")
    asks = " or ".join(f"“{page.link(str(tool), ChooseTool(tool))}”" for tool in _NEXT[failure.trouble])
    edge = failure.edge or _last_edge(query)
    if edge is None:
        page.html(f"<div>Then ask {asks}</div>")
    else:
        point = page.link(f"edge {edge[0]} → {edge[1]}", PointAt(*edge))
        page.html(f"<div>It drove {point}; point at it, then ask {asks}</div>")


def _last_edge(query: Query) -> EdgeKey | None:
    """Return the edge that was driven last, which led to where the robot thought that it had arrived."""
    driven = [(leg.source, leg.target) for leg in (attempt.started for attempt in query.attempts)]
    return next(((source, target) for source, target in reversed(driven) if source is not None), None)


def _drawing(case: Case, places: Sequence[Place], shown: Sequence[FailedQuery], now: FailedQuery | None) -> Overlay:
    strokes = []
    for failure in shown:
        ends = [] if failure.edge is None else [case.pose(node) for node in failure.edge]
        if len(ends) == 2 and ends[0] is not None and ends[1] is not None:
            strokes.append(stroke(ends[0], ends[1], palette.TARGET if failure is now else palette.WENT))
    nodes = {failure.node: palette.WENT for failure in shown if failure.node is not None}
    if now is not None and now.node is not None:
        nodes[now.node] = palette.TARGET
    return Overlay(tuple(strokes), nodes, labels=tuple(_labels(case, places, shown)))


def _labels(case: Case, places: Sequence[Place], shown: Sequence[FailedQuery]) -> list[Label]:
    kept, labels = {id(failure) for failure in shown}, []
    for place in places:
        count = sum(id(failure) in kept for failure in place.failures)
        pose = case.pose(place.nodes[0]) if place.nodes else None
        if count and pose is not None:
            labels.append(Label((float(pose[0]), float(pose[1])), f"{count} failed"))
    return labels
