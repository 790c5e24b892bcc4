"""Mapping advice: the gaps in the map so far, and the place to drive to next."""

from functools import partial
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import Link, Strong, joined
from ltvn_core.analysis.localisation_confidence import features_of
from ltvn_core.analysis.mapping_advice import MappingAdvice, advise_mapping
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
from ltvn_viz.wishes.commands import Action, Ask, PointAt

_LOOPS = 4
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
        _say(found, builder)
        return builder.build(_overlay(context, found, seen))


def _advise(
    live_map: LiveMap, graph: TopologicalGraph, seen: Observation, predictor: Predictor, method: Method
) -> MappingAdvice:
    """Compute the advice; runs in the worker's thread, which owns the images."""
    drive = {each.step: each.odometry for each in live_map.observations() if each.step <= seen.step}
    drive[seen.step] = seen.odometry
    steps = sorted(drive)
    matcher = Matcher(predictor, live_map.keyframes, method.matching)
    nodes = [node for node in graph.nodes if node in live_map.keyframes]
    current = matcher.match(features_of(seen, matcher, predictor), nodes) if nodes else None
    return advise_mapping(graph, steps, np.array([drive[step] for step in steps]), current)


def _say(advice: MappingAdvice, builder: AnswerBuilder) -> None:
    builder.add_line(Strong(str(advice.hint)))
    strongly_connected_components = len(advice.strongly_connected_components)
    builder.add_line(
        "The map is in one piece."
        if strongly_connected_components == 1
        else f"The map is in {strongly_connected_components} pieces."
    )
    links = [
        Link(f"{each.first} ↔ {each.second}", PointAt(each.first, each.second)) for each in advice.missing_closures
    ]
    more = f" and {len(links) - _LOOPS} more" if len(links) > _LOOPS else ""
    builder.add_line("Loops not closed: ", joined(links[:_LOOPS] or ["none"]), f"{more}.")
    builder.add_line(f"Places seen from one side only: {len(advice.one_sided_places)}.")
    if advice.novelty is not None:
        builder.add_line(f"The view now is {advice.novelty:.0%} new.")


def _overlay(context: DebugContext, advice: MappingAdvice, seen: Observation) -> Overlay:
    loops = [(loop.first, loop.second) for loop in advice.missing_closures]
    strokes = context.strokes(loops, palette.EDGE_REMOVED)
    apart = [node for part in advice.strongly_connected_components[1:] for node in part][:_COLOURED]
    ghosts = ()
    if advice.target is not None:
        # Advice is in the odometry frame, which drifts away from the frame of the drawing.
        here = seen.odometry if seen.exact_pose is None else seen.exact_pose
        target = compose(here, relative(seen.odometry, np.array(advice.target)))
        ghosts = ((float(target[0]), float(target[1]), float(target[2])),)
    return Overlay(strokes, dict.fromkeys(apart, palette.TARGET), ghosts)
