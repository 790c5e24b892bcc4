"""Mapping advice: the gaps in the map so far, and the place to drive to next."""

from collections.abc import Sequence
from functools import partial
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import Link
from ltvn_core.analysis.localisation_confidence import features_of
from ltvn_core.analysis.map_findings import MapFinding, map_findings
from ltvn_core.config import Method
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation, Predictor
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, is_live
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.wishes.commands import Action, Ask

_SHOWN = 4
_COLOURED = 500


class NextDriveQuestion(Question[Never]):
    """Advises the driver during mapping."""

    name = QuestionName.COACH
    is_offered = is_live
    about = "While you drive: what the map still lacks, and where to go next. The ghost robot marks the place."

    def __init__(self) -> None:
        """Start without advice."""
        self._advice = LatestAnswer()

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the latest advice, which is updated once a second at most."""
        builder = AnswerBuilder()
        frame = context.moment.frame
        seen = None if frame is None else context.observation(frame)
        if context.live_map is None:
            back = Link("go back to the robot", Ask(Action.CLOSE))
            builder.add_line("This advice is for driving; ", back, ". “What failed?” judges a recording.")
            return builder.build()
        if seen is None:
            builder.add_line("Drive a little, so that there is something to see.")
            return builder.build()
        question = "coach", int(context.moment.stamp), context.predictor.fingerprint
        found = self._advice(
            context.in_background,
            question,
            partial(_advise, context.live_map, context.graph, seen, context.predictor, context.method),
        )
        if found is None:
            builder.add_pending("Checking your drive")
            return builder.build()
        weak = [each for each in found[1:] if each.finding.remedy]
        builder.add_map_finding(found[0], is_first=True)
        for each in weak[:_SHOWN]:
            builder.add_map_finding(each)
        if len(weak) > _SHOWN:
            builder.add_line(f"… and {len(weak) - _SHOWN} more.")
        for each in found[1 + len(weak) :]:
            builder.add_map_finding(each)
        return builder.build(_overlay(context, found, seen))


def _advise(
    live_map: LiveMap, graph: TopologicalGraph, seen: Observation, predictor: Predictor, method: Method
) -> tuple[MapFinding, ...]:
    """Compute the advice; runs in the worker's thread, which owns the images."""
    drive = {each.step: each.odometry for each in live_map.observations() if each.step <= seen.step}
    drive[seen.step] = seen.odometry
    steps = sorted(drive)
    matcher = Matcher(predictor, live_map.keyframes, method.matching)
    nodes = [node for node in graph.nodes if node in live_map.keyframes]
    current = matcher.match(features_of(seen, matcher, predictor), nodes) if nodes else None
    return map_findings(graph, steps, np.array([drive[step] for step in steps]), current)


def _overlay(context: DebugContext, found: Sequence[MapFinding], seen: Observation) -> Overlay:
    strokes = context.strokes((edge for each in found for edge, _ in each.pairs), palette.EDGE_REMOVED)
    apart = [node for each in found for node in each.nodes][:_COLOURED]
    ghosts = ()
    if (goal := next((each.target for each in found if each.target), None)) is not None:
        # Advice is in the odometry frame, which drifts away from the frame of the drawing.
        here = seen.odometry if seen.exact_pose is None else seen.exact_pose
        target = compose(here, relative(seen.odometry, np.array(goal)))
        ghosts = ((float(target[0]), float(target[1]), float(target[2])),)
    return Overlay(strokes, dict.fromkeys(apart, palette.TARGET), ghosts)
