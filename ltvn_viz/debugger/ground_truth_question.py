"""Truth: in simulation, which edges are false, which are missing, and whether p is calibrated.

Of a place without a model only the true poses of the images are known: they tell which edges lead elsewhere.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import CalibrationChart, Key, Strong
from ltvn_core.errors import MapError, SceneError
from ltvn_core.evaluation.edge_accuracy import (
    MISPLACED_M,
    MISPLACED_RAD,
    AttemptCalibration,
    MissingEdge,
    attempt_calibration,
    calibration_attempts,
    edge_accuracy,
    misplaced,
    waypoint_errors,
)
from ltvn_core.evaluation.edge_accuracy import EdgeAccuracy as Verdicts
from ltvn_core.evaluation.ground_truth import GroundTruth, calibration_bins
from ltvn_core.evaluation.results import EdgeCalibrationBin
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import AttemptEnded, StampedEvent
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.scene_registry import check_scene, load_scene
from ltvn_core.types import FrameId, Observation, Pose
from ltvn_core.worlds import WorldState
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, edge_link
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection, stroke

_SPURIOUS = 15
_MISSING = 10
_LOOKED_AT = 4
"""Number of nodes that are checked for a known true pose."""


@dataclass(frozen=True, eq=False)
class JudgedMap:
    """The comparison of a map with the ground truth."""

    graph: TopologicalGraph
    poses: Mapping[FrameId, Pose]
    verdicts: Verdicts
    cells: tuple[EdgeCalibrationBin, ...]
    attempts: AttemptCalibration | None
    """Calibration of p by the attempts; None before any attempt."""


class GroundTruthQuestion(Question[Never]):
    """Compares the map with the ground truth of the simulator."""

    name = QuestionName.TRUTH
    about = (
        "By true poses: edges that lead elsewhere; in simulation, those that cannot be driven or are missing, and "
        "whether p is right."
    )

    def __init__(self) -> None:
        """Start without an answer."""
        self._latest = LatestAnswer()
        self._offered: tuple[object, bool] = None, False

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the images of this run have true poses; checks one image per run."""
        run = (context.name, context.start_s)
        nodes = context.moment.graph.ids[:_LOOKED_AT].tolist()
        if self._offered[0] != run and nodes:
            seen = next((image for node in nodes if (image := context.observation(node)) is not None), None)
            if seen is None:
                return True  # No image is in memory yet, so there may be true poses.
            self._offered = run, seen.exact_pose is not None
        return bool(nodes) and self._offered[1]

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the comparison, or the reason why there is none."""
        builder = AnswerBuilder()
        graph = context.graph
        if (why_not := _unknown(context)) is not None:
            builder.add_line(why_not)
            return builder.build()
        if not _is_simulated(context.scene):
            return _show_waypoints(builder, context, selection)
        self._latest.about((context.name, context.scene))
        events = context.timeline.events[: context.timeline.count_until(context.instant)]
        tried = [each.event for each in events if isinstance(each.event, AttemptEnded)]
        frames = {*context.graph.nodes, *(each.frame for each in tried), *(each.target for each in tried)}
        poses = {frame: pose for frame in frames if (pose := context.pose(frame)) is not None}
        near = context.method.building.connect_distance
        scene = context.scene
        world = context.timeline.progress_before(len(events)).world
        question = ("truth", context.name, scene, world, context.revision(AttemptEnded))
        judged = self._latest(
            context.in_background, question, lambda: _judged_map(scene, world, graph, poses, events, near)
        )
        if judged is None:
            builder.add_pending("Asking the simulator")
            return builder.build()
        builder.add_behind(self._latest)
        return _show(builder, judged, selection)


@lru_cache
def _is_simulated(scene: str) -> bool:
    try:
        check_scene(scene)
    except SceneError:
        return False
    return True


def _show_waypoints(builder: AnswerBuilder, context: DebugContext, selection: Selection) -> QuestionAnswer:
    """Compare the waypoints of the edges with true poses; nothing is known of walls, so of ways that are missing."""
    poses = {node: pose for node in context.graph.nodes if (pose := context.pose(node)) is not None}
    edges = [edge for edge in context.graph.driven_edges.values() if {edge.source, edge.target} <= poses.keys()]
    if not edges:
        builder.add_line("No edge of the map joins two images whose true poses are known.")
        return builder.build()
    errors = waypoint_errors(edges, poses)
    away_m, turned_deg = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    judged = zip(edges, away_m.tolist(), turned_deg.tolist(), misplaced(errors), strict=True)
    wrong = sorted(((edge, away, turned) for edge, away, turned, is_off in judged if is_off), key=lambda row: -row[1])
    limits = f"more than {MISPLACED_M} m or {math.degrees(MISPLACED_RAD):.0f}°"
    builder.add_line(Key(palette.EDGE_REMOVED, f"lead elsewhere, by {limits}: {len(wrong)} of {len(edges)} edges"))
    builder.add_line(
        *("The waypoints are wrong by ", Strong(f"{np.median(away_m):.2f} m"), " in the median and by "),
        f"{np.quantile(away_m, 0.9):.2f} m at the 90th percentile. Walls are unknown: this place has no model.",
    )
    nodes = builder.add_selected_edge(selection)
    rows = [
        (edge_link(edge.source, edge.target), f"{edge.belief.p:.2f}", f"{away:.2f}", f"{turned:.0f}")
        for edge, away, turned in wrong[:_SPURIOUS]
    ]
    builder.add_table(("leads elsewhere", "p", "off by m", "and by °"), rows)
    strokes = tuple(stroke(poses[edge.source], poses[edge.target], palette.EDGE_REMOVED) for edge, *_ in wrong)
    return builder.build(Overlay(strokes=strokes, nodes=nodes))


def _unknown(context: DebugContext) -> str | None:
    """Return the reason why the ground truth is unknown; None if it is known."""
    if not context.graph.nodes:
        return "There is no map yet, so no edge can be checked."
    nodes = list(context.graph.nodes)[:_LOOKED_AT]
    pictures = [seen for node in nodes if (seen := context.observation(node)) is not None]
    if pictures and all(seen.exact_pose is not None for seen in pictures):
        return None
    return (
        "The ground truth is unknown here, because the images have no true poses. A drive in a simulated scene has "
        "them; elsewhere, “What about this edge?” shows the attempts."
    )


def _judged_map(
    scene: str,
    world: WorldState,
    graph: TopologicalGraph,
    poses: Mapping[FrameId, Pose],
    events: Sequence[StampedEvent],
    near: float,
) -> JudgedMap:
    # An edge through a closed door cannot be driven at present.
    clearance = ChangedScenes(load_scene(scene)).at(replace(world, people=())).clearance
    truth = GroundTruth(clearance, _nobody, poses=poses)
    tried = attempt_calibration(calibration_attempts(events, truth))
    verdicts = edge_accuracy(graph, truth, near=near)
    return JudgedMap(graph, poses, verdicts, calibration_bins(graph, truth), tried)


def _nobody(frame: FrameId) -> Observation:
    raise MapError(f"The true pose of image {frame} is unknown.")


def _show(builder: AnswerBuilder, judged: JudgedMap, selection: Selection) -> QuestionAnswer:
    verdicts = judged.verdicts
    builder.add_line(
        Key(palette.EDGE_REMOVED, f"cannot be driven: {len(verdicts.spurious)}"),
        Key(palette.EDGE_ADDED, f"missing: {len(verdicts.missing)}"),
    )
    builder.add_line(
        *(Strong(_share(verdicts.precision)), " of the edges can be driven (precision). "),
        *(Strong(_share(verdicts.recall)), " of the neighbours have a short path (recall)."),
    )
    nodes = builder.add_selected_edge(selection)
    edges = judged.graph.edges
    worst = sorted((edges[key] for key in verdicts.spurious), key=lambda edge: -edge.belief.p)[:_SPURIOUS]
    rows = [
        (edge_link(edge.source, edge.target), f"{edge.belief.p:.2f}", f"{edge.successes}/{edge.attempts}")
        for edge in worst
    ]
    builder.add_table(("cannot be driven", "p", "succeeded"), rows)
    _missing(builder, verdicts.missing)
    builder.add_line(
        "Is p right? Each dot is a tenth of the scale; on the line, p equals the share of edges that can be driven."
    )
    cells = tuple((cell.mean_p, cell.drivable, cell.edges) for cell in judged.cells)
    builder.add_chart(CalibrationChart(cells, palette.SOURCE))
    if judged.attempts is not None:
        builder.add_line(calibration_sentence(judged.attempts))
    missing = [((pair.source, pair.target), palette.EDGE_ADDED) for pair in verdicts.missing]
    wrong = [(key, palette.EDGE_REMOVED) for key in sorted(verdicts.spurious)]
    strokes = [stroke(judged.poses[start], judged.poses[end], colour) for (start, end), colour in missing + wrong]
    return builder.build(Overlay(strokes=tuple(strokes), nodes=nodes))


def calibration_sentence(point: AttemptCalibration) -> str:
    """Return a sentence that compares p before the attempts of a run with their results."""
    count = "the one attempt" if point.attempts == 1 else f"the {point.attempts} attempts"
    judge = "the robot judged" if point.arrived is None else "it truly was"
    truly = "" if point.arrived is None else f", and in {point.arrived:.0%} it truly arrived"
    return (
        f"Before {count} up to now, p said on average that {point.mean_p:.0%} succeed; the robot took "
        f"{point.succeeded:.0%} for successes{truly}. The mean squared difference of p and arrival, as {judge}, is "
        f"{point.brier:.3f}: 0 would be best, and p = 0.5 for every edge would give 0.250."
    )


def _missing(builder: AnswerBuilder, missing: Sequence[MissingEdge]) -> None:
    # Most missing edges are missing in both directions, so both share one row.
    pairs = {(min(pair.source, pair.target), max(pair.source, pair.target)): pair for pair in reversed(missing)}
    rows = [
        (
            edge_link(pair.source, pair.target),
            f"{pair.distance:.2f}",
            f"{pair.path:.1f}" if math.isfinite(pair.path) else "none, or far longer",
        )
        for pair in list(reversed(pairs.values()))[:_MISSING]
    ]
    builder.add_table(("missing, in one or both directions", "apart", "path in the map"), rows)


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}"
