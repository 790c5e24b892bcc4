"""The collect coach: what the map lacks so far, and where to drive next."""

from collections.abc import Callable
from html import escape

import numpy as np

from ltvn_core.analysis.coach import Advice, advise
from ltvn_core.analysis.where import image_of
from ltvn_core.config import Method
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.types import Observation, Predictor
from ltvn_viz import palette
from ltvn_viz.commands import CloseRecording, PointAt
from ltvn_viz.mapping import Mapping
from ltvn_viz.why.case import Case
from ltvn_viz.why.later import Latest
from ltvn_viz.why.overlay import NOTHING, Overlay, stroke
from ltvn_viz.why.tool import Page, Selection, ToolView

_LOOPS = 4
_COLOURED = 500


class CoachTool:
    """Looks over the shoulder of whoever drives."""

    about = "While you drive: what the map still lacks, and where to go next. The ghost stands there."

    def __init__(self) -> None:
        """Begin without advice."""
        self._advice = Latest()

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show the latest advice, which is renewed once a second at most."""
        page = Page()
        frame = case.moment.frame
        seen = None if frame is None else case.picture(frame)
        if case.mapping is None:
            back = page.link("go back to the robot", CloseRecording())
            page.html(f"<div>The coach helps while one drives; {back}. “What failed?” judges a recording.</div>")
            return page.view()
        if seen is None:
            page.line("Drive a little, so that there is something to see.")
            return page.view()
        question = "coach", int(case.moment.stamp), case.predictor.fingerprint
        found = self._advice(case.later, question, _advise(case.mapping, case.graph, seen, case.predictor, case.method))
        if found is None:
            page.line("Looking at what you drove …")
            return page.view()
        _say(found, page)
        return page.view(_overlay(case, found, seen))

    def told(self, case: Case, text: str) -> None:
        """Take nothing in."""
        raise OptionError("Nothing is asked here; drive, and the advice follows.")


def _advise(
    mapping: Mapping, graph: TopologicalGraph, seen: Observation, predictor: Predictor, method: Method
) -> Callable[[], Advice]:
    def look_over() -> Advice:
        """Run in the worker's thread, which owns the images."""
        drive = {each.step: each.odometry for each in mapping.images() if each.step <= seen.step}
        drive[seen.step] = seen.odometry
        steps = sorted(drive)
        matcher = Matcher(predictor, mapping.views, method.matching)
        nodes = [node for node in graph.nodes if node in mapping.views]
        current = matcher.match(image_of(seen, matcher, predictor), nodes) if nodes else None
        return advise(graph, steps, np.array([drive[step] for step in steps]), current)

    return look_over


def _say(advice: Advice, page: Page) -> None:
    page.html(f"<div><b>{escape(advice.hint.text)}</b></div>")
    pieces = len(advice.pieces)
    page.line("The map is in one piece." if pieces == 1 else f"The map is in {pieces} pieces.")
    links = [page.link(f"{each.first} ↔ {each.second}", PointAt(each.first, each.second)) for each in advice.loops]
    more = f" and {len(links) - _LOOPS} more" if len(links) > _LOOPS else ""
    page.html(f"<div>Loops not closed: {' · '.join(links[:_LOOPS]) or 'none'}{more}.</div>")
    page.line(f"Places seen from one side only: {len(advice.one_sided)}.")
    if advice.novelty is not None:
        page.line(f"The view now is {advice.novelty:.0%} new.")


def _overlay(case: Case, advice: Advice, seen: Observation) -> Overlay:
    ends = [(case.pose(loop.first), case.pose(loop.second)) for loop in advice.loops]
    strokes = tuple(stroke(start, end, palette.WENT) for start, end in ends if start is not None and end is not None)
    apart = [node for part in advice.pieces[1:] for node in part][:_COLOURED]
    ghosts = ()
    if advice.hint.target is not None:
        # Advice is given in the frame of odometry, which drifts away from the one that is drawn.
        here = seen.odometry if seen.exact_pose is None else seen.exact_pose
        target = compose(here, relative(seen.odometry, np.array(advice.hint.target)))
        ghosts = ((float(target[0]), float(target[1]), float(target[2])),)
    drawn = Overlay(strokes, dict.fromkeys(apart, palette.TARGET), ghosts)
    return drawn if strokes or apart or ghosts else NOTHING
