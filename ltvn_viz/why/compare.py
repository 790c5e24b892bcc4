"""Compare: this map against another one, or against what it was before the first query, with figures and in colours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.analysis.compare import EdgeDifference, Figures, MapDifference, compare, figures
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import LtvnError
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_core.nav.events import Judged, QueryEnded, Stamped
from ltvn_core.recording.reader import Recording
from ltvn_core.types import NodeId, Pose
from ltvn_viz import palette
from ltvn_viz.commands import PointAt, Tell
from ltvn_viz.why.case import Case
from ltvn_viz.why.later import Latest
from ltvn_viz.why.overlay import Overlay, Stroke, stroke
from ltvn_viz.why.pictures import chip
from ltvn_viz.why.pointing import pointed
from ltvn_viz.why.tool import Page, Selection, ToolView

BEFORE = "before its first query"
LIST = "choose another"
_NAMES, _ROWS, _STROKES = 10, 20, 4000
_ASKS = "Name of a recording"


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two maps, and what happened to it."""

    name: str
    scene: str
    graph: TopologicalGraph
    events: Sequence[Stamped]
    poses: Mapping[NodeId, Pose]


@dataclass(frozen=True, eq=False)
class Compared:
    """The answer."""

    here: Side
    there: Side
    figures: tuple[Figures, Figures]
    difference: MapDifference | None
    """None across scenes."""


class CompareTool:
    """Shows what is different in another map."""

    about = "This map against another: figures of both, and the edges that differ, those that matter most first."

    def __init__(self) -> None:
        """Compare with nothing yet."""
        self._other = ""
        self._latest = Latest()
        self._start: tuple[Timeline, Side] | None = None

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Offer recordings, or show what is different in the chosen one."""
        page = Page()
        if not self._other:
            return _offer(case, page)
        page.html(f"<div>{page.link(LIST, Tell(LIST))}</div>")
        try:
            there = self._there(case)
        except LtvnError as error:
            page.line(str(error))
            return page.view()
        if there is None:
            page.line(f"Opening {self._other} …")
            return page.view()
        here = case.name, case.scene, case.graph, case.timeline.events[: case.timeline.count_until(case.instant)]
        poses = _poses(case, case.graph)
        question = ("compare", case.name, case.told(QueryEnded, Judged), there.name)
        found = self._latest(case.later, question, lambda: _compared(Side(*here, poses), there))
        if found is None:
            page.line("Comparing …")
            return page.view()
        _figures(page, found)
        return _difference(page, found, selection)

    def told(self, case: Case, text: str) -> None:
        """Take the name of the other recording; raises RecordingError if there is none of that name."""
        name = text.strip()
        if name not in (LIST, BEFORE):
            case.library.path(name)
        self._other = "" if name == LIST else name
        self._latest.forget()

    def _there(self, case: Case) -> Side | None:
        if self._other == BEFORE:
            if self._start is None or self._start[0] is not case.timeline:
                self._start = case.timeline, _before(case)
            return self._start[1]
        path = case.library.path(self._other)
        return case.later(("open", self._other, path.stat().st_mtime_ns), lambda: _opened(path))


def _offer(case: Case, page: Page) -> ToolView:
    page.line("Compare with:")
    names = [name for name in case.library.names() if name != case.name]
    offered = [f"this run, {page.link(BEFORE, Tell(BEFORE))}"] if case.timeline.queries else []
    offered += [page.link(name, Tell(name)) for name in names[:_NAMES]]
    for each in offered:
        page.html(f"<div>{each}</div>")
    if not offered:
        page.line("There is nothing yet: copy a recording or a map into the recordings folder, or drive to a goal.")
    if len(names) > _NAMES:
        page.line(f"… and {len(names) - _NAMES} more: type the name.")
    return page.view(asks=_ASKS)


def _before(case: Case) -> Side:
    first = case.timeline.queries[0].first if case.timeline.queries else len(case.timeline.events)
    graph = case.timeline.graph_before(first)
    return Side(BEFORE, case.scene, graph, case.timeline.events[:first], _poses(case, graph))


def _opened(path: Path) -> Side:
    recording = Recording.open(path)
    poses = recording.poses
    drawn = poses.odometry if poses.exact is None else poses.exact
    where = dict(zip(poses.steps.tolist(), drawn, strict=True))
    return Side(path.name, recording.meta.scene, recording.final_graph(), recording.events, where)


def _poses(case: Case, graph: TopologicalGraph) -> dict[NodeId, Pose]:
    return {node: pose for node in graph.nodes if (pose := case.pose(node)) is not None}


def _compared(here: Side, there: Side) -> Compared:
    both = figures(here.graph, here.events), figures(there.graph, there.events)
    difference = None
    if here.scene == there.scene:
        difference = compare(here.graph, there.graph, poses_a=here.poses, poses_b=there.poses)
    return Compared(here, there, both, difference)


def _figures(page: Page, found: Compared) -> None:
    names = found.here.name or "the live run", found.there.name
    rows = [
        (what, *(tell(each) for each in found.figures))
        for what, tell in (
            ("nodes", lambda each: f"{each.nodes:,}"),
            ("edges", lambda each: f"{each.edges:,}"),
            ("pieces", lambda each: str(each.pieces)),
            ("mean p", lambda each: "–" if each.mean_p is None else f"{each.mean_p:.3f}"),
            ("arrived, of queries", lambda each: f"{each.arrived} of {each.queries}"),
            ("reached, judged by truth", lambda each: "–" if each.reached is None else str(each.reached)),
            ("collisions", lambda each: str(each.collisions)),
        )
    ]
    page.table(("", *names), rows)


def _difference(page: Page, found: Compared, selection: Selection) -> ToolView:
    difference = found.difference
    if difference is None:
        page.line("They were made in different scenes, so no edge of one is an edge of the other.")
        return page.view()
    believed = sum(each.a is not None and each.b is not None for each in difference.differing)
    page.html(
        f"<div>{chip(palette.CAME, f'only here: {len(difference.edges_only_a)}')} "
        f"{chip(palette.WENT, f'only there: {len(difference.edges_only_b)}')} "
        f"{chip(palette.PLAN, f'believed differently: {believed}')}</div>"
    )
    page.line(f"{len(difference.nodes)} nodes are in both, known by their {difference.matched_by}.")
    nodes = pointed(page, selection)
    if difference.differing:
        back = {other: node for node, other in difference.nodes.items()}
        rows = [_row(page, each, back) for each in difference.differing[:_ROWS]]
        page.table(("edge", "p here", "p there", "of all ways"), rows)
        if len(difference.differing) > _ROWS:
            page.line(f"… and {len(difference.differing) - _ROWS} more that matter less.")
    return page.view(Overlay(strokes=_strokes(found, difference), nodes=nodes))


def _row(page: Page, each: EdgeDifference, back: Mapping[NodeId, NodeId]) -> tuple[str, ...]:
    shares = "–" if each.share < 5e-4 else f"{each.share:.1%}"
    return _name(page, each, back), _p(each.a), _p(each.b), shares


def _name(page: Page, each: EdgeDifference, back: Mapping[NodeId, NodeId]) -> str:
    """Return a link to the edge, or plain numbers of the other map where this one has no such nodes."""
    if each.a is not None:
        key: EdgeKey = each.a.source, each.a.target
    else:
        assert each.b is not None
        if each.b.source not in back or each.b.target not in back:
            return f"{each.b.source} → {each.b.target} there"
        key = back[each.b.source], back[each.b.target]
    return page.link(f"{key[0]} → {key[1]}", PointAt(*key))


def _p(edge: Edge | None) -> str:
    return "–" if edge is None else f"{edge.belief.p:.2f} ({edge.successes}/{edge.attempts})"


def _strokes(found: Compared, difference: MapDifference) -> tuple[Stroke, ...]:
    strokes = []
    for each in difference.differing[:_STROKES]:
        edge, poses = (each.a, found.here.poses) if each.a is not None else (each.b, found.there.poses)
        assert edge is not None
        if edge.source in poses and edge.target in poses:
            colour = palette.PLAN if each.a and each.b else palette.CAME if each.a else palette.WENT
            strokes.append(stroke(poses[edge.source], poses[edge.target], colour))
    return tuple(strokes)
