"""Truth: in simulation, which edges nobody can drive, which ones are missing, and whether p keeps its promise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ltvn_core.errors import MapError, OptionError
from ltvn_core.evaluate.promises import CalibrationPoint, calibration_over_queries
from ltvn_core.evaluate.results import CalibrationCell
from ltvn_core.evaluate.truth import MapTruth, calibration
from ltvn_core.evaluate.truth_overlay import Missing, overlay
from ltvn_core.evaluate.truth_overlay import Overlay as Verdicts
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_core.nav.events import LegEnded, QueryEnded, Stamped
from ltvn_core.sim.scenes import load_scene
from ltvn_core.types import FrameId, Observation, Pose
from ltvn_viz import palette
from ltvn_viz.commands import PointAt
from ltvn_viz.why.case import Case
from ltvn_viz.why.later import Latest
from ltvn_viz.why.overlay import Overlay, Stroke, stroke
from ltvn_viz.why.pictures import chip, promise
from ltvn_viz.why.pointing import pointed
from ltvn_viz.why.tool import Page, Selection, ToolView

_SPURIOUS, _MISSING = 15, 10
_LOOKED_AT = 4
"""So many nodes are asked whether anybody knows where they truly are."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The answer."""

    graph: TopologicalGraph
    poses: Mapping[FrameId, Pose]
    verdicts: Verdicts
    cells: tuple[CalibrationCell, ...]
    attempts: CalibrationPoint | None
    """None before any attempt."""


class TruthTool:
    """Holds the map against the simulator."""

    about = "In simulation: edges that nobody can drive, edges that are missing, and whether p tells the truth."

    def __init__(self) -> None:
        """Know nothing yet."""
        self._latest = Latest()
        self._about: tuple[str, str] = "", ""

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show the verdicts, or say why there are none."""
        page, graph = Page(), case.graph
        if (why_not := _unknown(case)) is not None:
            page.line(why_not)
            return page.view()
        if self._about != (case.name, case.scene):
            self._about = case.name, case.scene
            self._latest.forget()
        events = case.timeline.events[: case.timeline.count_until(case.instant)]
        poses, near, scene = _poses(case, events), case.method.building.connect_distance, case.scene
        question = ("truth", case.name, scene, case.told(LegEnded, QueryEnded))
        judged = self._latest(case.later, question, lambda: _judged(scene, graph, poses, events, near))
        if judged is None:
            page.line("Asking the simulator …")
            return page.view()
        return _show(page, judged, selection)

    def told(self, case: Case, text: str) -> None:
        """Take nothing in."""
        raise OptionError("Nothing is asked here; click an edge of the table.")


def _unknown(case: Case) -> str | None:
    """Return why nobody knows the truth; None where it is known."""
    if not case.graph.nodes:
        return "There is no map yet whose edges could be true or false."
    nodes = list(case.graph.nodes)[:_LOOKED_AT]
    pictures = [seen for node in nodes if (seen := case.picture(node)) is not None]
    if pictures and all(seen.exact_pose is not None for seen in pictures):
        return None
    return (
        "Nobody knows the truth here: the images do not say where they were really taken. A drive in a simulated "
        "scene does; elsewhere, “What about this edge?” tells what driving taught."
    )


def _poses(case: Case, events: Sequence[Stamped]) -> dict[FrameId, Pose]:
    frames = {stamped.event.frame for stamped in events if isinstance(stamped.event, LegEnded)}
    frames |= {stamped.event.target for stamped in events if isinstance(stamped.event, LegEnded)}
    return {frame: pose for frame in frames | set(case.graph.nodes) if (pose := case.pose(frame)) is not None}


def _judged(
    scene: str, graph: TopologicalGraph, poses: Mapping[FrameId, Pose], events: Sequence[Stamped], near: float
) -> Judged:
    truth = MapTruth(load_scene(scene).clearance, _nobody, poses=poses)
    points = calibration_over_queries(events, truth)
    verdicts = overlay(graph, truth, near=near)
    return Judged(graph, poses, verdicts, calibration(graph, truth), points[-1] if points else None)


def _nobody(frame: FrameId) -> Observation:
    raise MapError(f"Nobody knows where image {frame} was taken.")


def _show(page: Page, judged: Judged, selection: Selection) -> ToolView:
    verdicts = judged.verdicts
    page.html(
        f"<div>{chip(palette.WENT, f'cannot be driven: {len(verdicts.spurious)}')} "
        f"{chip(palette.CAME, f'missing: {len(verdicts.missing)}')}</div>"
    )
    page.html(
        f"<div><b>{_share(verdicts.precision)}</b> of the edges can be driven (precision). "
        f"<b>{_share(verdicts.recall)}</b> of the neighbours have a short way (recall).</div>"
    )
    nodes = pointed(page, selection)
    _spurious(page, judged)
    _missing(page, verdicts.missing)
    page.line("Does p tell the truth? Each dot is a tenth of the scale; on the line, p is the share that is true.")
    page.html(promise([(cell.mean_p, cell.drivable, cell.edges) for cell in judged.cells], palette.SOURCE))
    if (point := judged.attempts) is not None:
        truly = "" if point.arrived is None else f", {point.arrived:.0%} truly"
        page.line(
            f"{point.attempts} attempts: p foretold {point.mean_p:.0%}, {point.succeeded:.0%} succeeded{truly}; "
            f"mean squared error {point.brier:.3f}."
        )
    return page.view(Overlay(strokes=_strokes(judged), nodes=nodes))


def _spurious(page: Page, judged: Judged) -> None:
    edges = judged.graph.edges
    worst = sorted(judged.verdicts.spurious, key=lambda key: -edges[key].belief.p)
    if not worst:
        return
    rows = [
        (_edge(page, key), f"{edges[key].belief.p:.2f}", f"{edges[key].successes}/{edges[key].attempts}")
        for key in worst[:_SPURIOUS]
    ]
    page.table(("cannot be driven", "p", "succeeded"), rows)


def _missing(page: Page, missing: Sequence[Missing]) -> None:
    if not missing:
        return
    # Most ways are missing in both directions, and one row says so.
    pairs = {(min(pair.source, pair.target), max(pair.source, pair.target)): pair for pair in reversed(missing)}
    rows = [
        (_edge(page, (pair.source, pair.target)), f"{pair.distance:.2f}", _way(pair))
        for pair in list(reversed(pairs.values()))[:_MISSING]
    ]
    page.table(("missing, one way or both", "apart", "way in the map"), rows)


def _way(pair: Missing) -> str:
    return f"{pair.path:.1f}" if math.isfinite(pair.path) else "none, or far longer"


def _edge(page: Page, key: EdgeKey) -> str:
    return page.link(f"{key[0]} → {key[1]}", PointAt(*key))


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}"


def _strokes(judged: Judged) -> tuple[Stroke, ...]:
    missing = [((pair.source, pair.target), palette.CAME) for pair in judged.verdicts.missing]
    wrong = [(key, palette.WENT) for key in sorted(judged.verdicts.spurious)]
    return tuple(
        stroke(judged.poses[source], judged.poses[target], colour) for (source, target), colour in missing + wrong
    )
