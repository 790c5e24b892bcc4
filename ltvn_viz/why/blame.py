"""Why an edge is gone, weak, chosen or missing, and why a node is here, as sentences that lead into time.

Owns which of these questions make sense. The sentences are made in `ltvn_core.analysis.blame`.
"""

import re
from collections.abc import Sequence
from html import escape

from ltvn_core.analysis import blame
from ltvn_core.analysis.edges import EdgeStory, edge_story
from ltvn_core.analysis.reasons import Reason, ReasonKind
from ltvn_core.analysis.records import MarkKind
from ltvn_core.errors import OptionError
from ltvn_core.geometry import distance
from ltvn_core.graph.operators import Gates
from ltvn_core.types import NodeId
from ltvn_viz import palette
from ltvn_viz.commands import ChooseTool, PointAt
from ltvn_viz.why.case import Case
from ltvn_viz.why.overlay import Overlay, Stroke, stroke
from ltvn_viz.why.tool import NOWHERE, EdgeKey, Page, Selection, ToolName, ToolView
from ltvn_viz.why.weighing import weighing

_SENTENCES = 8
"""Of a longer chain the beginning and the end are told."""
_GONE = 12


class BlameTool:
    """Tells the reasons."""

    about = (
        "The reasons behind an edge or a node, each with its moment. Click a node, then another, or type two numbers."
    )

    def __init__(self) -> None:
        """Begin with nothing typed."""
        self._typed: EdgeKey | None = None
        self._under = NOWHERE

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Tell why the edge or the node is as it is at the moment."""
        if selection != self._under:
            self._under, self._typed = selection, None
        page, asks = Page(), "From node, to node"
        edge = self._typed or selection.edge
        if edge is not None:
            self._edge(case, edge, page)
            return page.view(_overlay(case, edge), asks)
        if selection.node is None:
            page.line("Click a node in the scene, then its neighbour; or type two numbers to ask about an edge.")
            return page.view(asks=asks)
        self._node(case, selection.node, selection.before, page)
        return page.view(Overlay(nodes={selection.node: palette.SOURCE}), asks)

    def told(self, case: Case, text: str) -> None:
        """Ask about the edge between two nodes."""
        numbers = [int(number) for number in re.findall(r"\d+", text)]
        if len(numbers) != 2 or numbers[0] == numbers[1]:
            raise OptionError("Type the numbers of two different nodes, from and to, for instance: 12 40.")
        self._typed = numbers[0], numbers[1]

    def _node(self, case: Case, node: NodeId, before: NodeId | None, page: Page) -> None:
        self._chain(case, f"Why is node {node} here?", blame.node_here(case.timeline, node, at=case.instant), page)
        if before not in (None, node):
            asked = page.link(f"Why is there no edge {before} → {node}?", PointAt(before, node))
            page.html(f"<div>{asked}</div>")
        gone = dict.fromkeys(
            mark.ids for mark in case.timeline.marks_until(case.instant, MarkKind.PRUNE) if node in mark.ids[:2]
        )
        links = [page.link(f"{ids[0]} → {ids[1]}", PointAt(*ids)) for ids in [*gone][-_GONE:] if len(ids) == 2]
        if links:
            page.html(f"<div>Edges that were pruned here: {', '.join(links)}.</div>")

    def _edge(self, case: Case, edge: EdgeKey, page: Page) -> None:
        back = page.link("the way back", PointAt(edge[1], edge[0]))
        closer = page.link("look closer", ChooseTool(ToolName.EDGE))
        page.html(
            f"<div>Edge <b>{edge[0]} → {edge[1]}</b> · {back}{f' · {closer}' if self._typed is None else ''}</div>"
        )
        story = edge_story(case.timeline, *edge, case.instant)
        if not story.lives:
            self._chain(case, "Why is it missing?", self._missing(case, edge), page)
        elif story.alive:
            self._chain(case, _doubt(story), blame.weak(case.timeline, *edge, at=case.instant), page)
        else:
            told = blame.gone(case.timeline, *edge, at=case.instant, believing=case.method.believing)
            self._chain(case, "Why is it gone?", told, page)
        self._ahead(case, edge, story, page)
        if story.planned:
            self._chosen(case, edge, story, page)
        elif story.lives:
            page.line("No plan has led through it yet.")

    def _missing(self, case: Case, edge: EdgeKey) -> Sequence[Reason]:
        seen, gates = _seen(case, edge), Gates.building(case.method.building)
        return blame.missing(case.timeline, *edge, at=case.instant, seen=seen, gates=gates)

    def _ahead(self, case: Case, edge: EdgeKey, story: EdgeStory, page: Page) -> None:
        """Say what is still to come of an edge, where the run goes on after the moment."""
        later = edge_story(case.timeline, *edge)
        if story.alive and later.lives and (end := later.lives[len(story.lives) - 1].end) is not None:
            page.html(f"<div>Later it leaves the map, at {page.jump(case.seconds(end.instant))}.</div>")
        elif not story.alive and len(later.lives) > len(story.lives):
            born = later.lives[len(story.lives)].born
            page.html(f"<div>Later it comes {'back' * bool(story.lives)} in, at {page.jump(case.seconds(born))}.</div>")

    def _chosen(self, case: Case, edge: EdgeKey, story: EdgeStory, page: Page) -> None:
        timeline, planning, last = case.timeline, case.method.planning, story.planned[-1]
        how = weighing(case)
        weight = how.weights(case.method)
        # Planning again takes time on a large map, and the answer stays as long as no newer plan comes.
        told = case.later(
            ("chosen", case.name, case.start_s, edge, last),
            lambda: blame.chosen(timeline, *edge, planning, at=last, weight=weight),
        )
        title = "Why was it chosen?"
        if told is None:
            page.html(f"<div><b>{title}</b> Planning once more without it …</div>")
        else:
            self._chain(case, title, told, page)
            if how.note:
                page.line(how.note)

    @staticmethod
    def _chain(case: Case, title: str, reasons: Sequence[Reason], page: Page) -> None:
        page.html(f"<div><b>{escape(title)}</b></div>")
        left_out = len(reasons) - _SENTENCES
        for number, reason in enumerate(reasons):
            if left_out > 0 and 1 <= number <= left_out:
                if number == 1:
                    page.line(f"… {left_out} more like these …")
                continue
            # What never happened has no moment of its own.
            at = None if reason.kind is ReasonKind.NEVER else reason.instant
            when = "" if at is None else page.jump(case.seconds(at)) + " "
            page.html(f"<div>{when}{escape(reason.text.replace('->', '→'))}</div>")


def _doubt(story: EdgeStory) -> str:
    belief = story.lives[-1].history[-1].belief
    return f"Why is it so weak, p = {belief.p:.2f}?" if belief.p < 0.5 else f"Why is p = {belief.p:.2f}?"


def _seen(case: Case, edge: EdgeKey) -> tuple[float, float] | None:
    """Return (r, d) of the pair as the network in use sees it; None without images or as long as it is at work."""
    views = [case.picture(node) for node in edge]
    if None in views:
        return None
    pictures, predictor = [view for view in views if view is not None], case.predictor

    def compare() -> tuple[float, float]:
        features = predictor.encode(pictures)
        said = predictor.predict(features[:1], features[1:])
        return float(said.reachability[0]), float(distance(said.waypoints)[0])

    return case.later(("pair", case.name, predictor.fingerprint, edge), compare)


def _overlay(case: Case, edge: EdgeKey) -> Overlay:
    start, end = (case.pose(node) for node in edge)
    strokes: tuple[Stroke, ...] = ()
    if start is not None and end is not None:
        strokes = (stroke(start, end, palette.TARGET),)
    return Overlay(strokes=strokes, nodes={edge[0]: palette.SOURCE, edge[1]: palette.TARGET})
