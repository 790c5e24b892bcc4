"""Where the robot might be: the current view against every node, how sure that was over time, and look-alike places."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from ltvn_core.analysis.lookalikes import Lookalike, find_lookalikes
from ltvn_core.analysis.records import Instant
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.where import Heat, Margins, heat, image_of, margins
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.types import NodeId, Observation, Predictor
from ltvn_viz import palette
from ltvn_viz.commands import PointAt, Seek, Tell
from ltvn_viz.palette import Rgb8
from ltvn_viz.why.case import Case
from ltvn_viz.why.later import Latest
from ltvn_viz.why.overlay import NOTHING, Overlay, Stroke, stroke
from ltvn_viz.why.pictures import curve
from ltvn_viz.why.sights import Sights
from ltvn_viz.why.tool import Page, Selection, ToolView

_COLOURED = 1000
_LOOKS = 200
_SMALLEST = 5
_PAIRS = 8
_CANDIDATES = 8
"""Nodes with the most similar pictures that each node is compared with; more takes longer."""
_SMALL = 0.3
_ALIKE = "look-alikes"


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One view against all nodes, ready to be drawn."""

    heat: Heat
    colours: dict[NodeId, Rgb8] = field(default_factory=dict)


class WhereTool:
    """Compares what is seen now with the whole map."""

    about = "How near each node looks from the current view: blue is near. And how sure the robot was over time."

    def __init__(self) -> None:
        """Begin with nothing compared."""
        self._sights, self._heat = Sights(), Latest()
        self._margins: tuple[Timeline | None, Margins] = (None, margins(()))
        self._asked: tuple[object, ...] | None = None
        self._run = ""

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Colour the nodes and say which are best."""
        page = Page()
        if case.weights not in ("", case.predictor.fingerprint):
            page.line("This was recorded with other weights; the colours show what the weights in use say.")
        shown = self._compared(case, page)
        self._told_then(case, page)
        strokes = self._alike(case, page)
        nodes = shown.colours if shown is not None else {}
        return page.view(Overlay(strokes, nodes) if nodes or strokes else NOTHING)

    def told(self, case: Case, text: str) -> None:
        """Search for places that look alike. Raises OptionError."""
        if text != _ALIKE:
            raise OptionError("Nothing is asked here; follow a link, or click a node in the scene.")
        self._asked = "alike", case.name, len(case.timeline.changes_until(case.instant))

    def _compared(self, case: Case, page: Page) -> Shown | None:
        nodes, frame = tuple(case.graph.nodes), case.moment.frame
        if case.name != self._run:
            self._run = case.name
            self._heat.forget()
        seen = None if frame is None else case.picture(frame)
        if not nodes or seen is None:
            page.line("The map is empty." if not nodes else "There is no image of this moment to compare.")
            return None
        views, missing = self._sights.of(case)
        if missing:
            page.line(f"Reading the images of {len(nodes)} nodes, {missing} to go …")
        question = "where", case.name, frame, len(nodes), missing, case.predictor.fingerprint
        found = self._heat(case.later, question, _heat(seen, nodes, views, case.predictor, case.method))
        if found is None:
            page.line("Comparing …")
        elif isinstance(found, str):
            page.line(found)
        else:
            _say(found.heat, page)
            return found
        return None

    def _told_then(self, case: Case, page: Page) -> None:
        """Show what the run itself found, look by look."""
        if self._margins[0] is not case.timeline:
            self._margins = case.timeline, margins(case.timeline.events)
        looks = self._margins[1]
        until = int(np.searchsorted(looks.steps, case.step, "right"))
        rows = range(max(0, until - _LOOKS), until)
        if not rows:
            return
        page.line(f"Margin of best over second in the last {len(rows)} looks (from 0 to 1 and above):")
        times = [case.seconds(Instant(int(looks.steps[k]), float(looks.stamps[k]))) for k in rows]
        points = [(time, min(1.0, float(looks.margins[k]))) for time, k in zip(times, rows, strict=True)]
        page.html(curve(points, lines=((_SMALL, "ambiguous"),), colour=palette.SOURCE))
        self._smallest(looks, rows, times, page)

    @staticmethod
    def _smallest(looks: Margins, rows: range, times: Sequence[float], page: Page) -> None:
        small = sorted((float(looks.margins[k]), time) for k, time in zip(rows, times, strict=True))
        links = [page.link(f"{margin:.2f} at {time:.1f} s", Seek(time)) for margin, time in small[:_SMALLEST]]
        page.html(f"<div>Smallest: {' · '.join(links)}</div>")

    def _alike(self, case: Case, page: Page) -> tuple[Stroke, ...]:
        link = page.link("search for places that look alike", Tell(_ALIKE))
        if self._asked is None or self._asked[1] != case.name:
            page.html(f"<div>{link}</div>")
            return ()
        views, missing = self._sights.of(case)
        if missing:
            page.line("Look-alike places are searched as soon as all images are read.")
            return ()
        found = case.later(self._asked, _lookalikes(case.graph, views, case.predictor, case.method))
        if found is None or isinstance(found, str):
            page.line(found or "Searching for places that look alike, which takes its time …")
            return ()
        return _pairs(case, found, page)


def _heat(
    seen: Observation, nodes: tuple[NodeId, ...], views: Views, predictor: Predictor, method: Method
) -> Callable[[], Shown | str]:
    def compare() -> Shown | str:
        """Run in the worker's thread, which owns the images."""
        known = [node for node in nodes if node in views]
        if not known:
            return "There are no images of the nodes to compare with."
        matcher = Matcher(predictor, views, method.matching)
        found = heat(image_of(seen, matcher, predictor), known, matcher, method.localising)
        return Shown(found, _colours(found, method.localising.distance))

    return compare


def _colours(found: Heat, scale: float) -> dict[NodeId, Rgb8]:
    """Colour the nodes that look nearest by their scores; at a score of D_l a node is half near."""
    rows = np.argsort(found.scores, kind="stable")[:_COLOURED]
    rgb = palette.probability_colours(scale / (scale + np.maximum(found.scores[rows], 0.0)))
    return {found.nodes[row]: Rgb8(*colour) for row, colour in zip(rows, rgb.tolist(), strict=True)}


def _say(found: Heat, page: Page) -> None:
    best = [found.nodes.index(node) for node in found.best(2)]
    rows = []
    for rank, k in zip(("best", "second"), best, strict=False):
        node = page.link(f"node {found.nodes[k]}", PointAt(found.nodes[k]))
        here = "may be here" if found.near[k] else "too far"
        rows.append((rank, node, f"{found.distances[k]:.2f}", f"{found.reachability[k]:.2f}", here))
    page.table(("", "", "d", "r", ""), rows)
    if len(best) > 1:
        sure = "ambiguous" if found.margin < _SMALL else "clear"
        page.html(f"<div>Margin <b>{found.margin:.2f}</b>, {sure}; {int(found.near.sum())} nodes near enough.</div>")


def _lookalikes(
    graph: TopologicalGraph, views: Views, predictor: Predictor, method: Method
) -> Callable[[], tuple[Lookalike, ...] | str]:
    def search() -> tuple[Lookalike, ...] | str:
        """Run in the worker's thread, which owns the images."""
        try:
            return find_lookalikes(graph, Matcher(predictor, views, method.matching), method, candidates=_CANDIDATES)
        except LtvnError as error:
            return str(error)

    return search


def _pairs(case: Case, found: Sequence[Lookalike], page: Page) -> tuple[Stroke, ...]:
    page.line(f"{len(found)} look-alike pairs:" if found else "No two places look alike.")
    for pair in found[:_PAIRS]:
        link = page.link(f"{pair.first} ↔ {pair.second}", PointAt(pair.first, pair.second))
        page.html(f"<div>{link}: {escape(pair.sentence)}</div>")
    ends = [(case.pose(pair.first), case.pose(pair.second)) for pair in found[:_PAIRS]]
    return tuple(stroke(start, end, palette.WENT) for start, end in ends if start is not None and end is not None)
