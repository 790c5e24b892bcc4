"""What events look like in the Rerun viewer: plan, goal, subgoal, pruned edges, curves, state and log.

Pure functions; owns shapes and colours. Keeps no memory except which edges have a curve (`BeliefCurves`).
"""

import math
from collections.abc import Sequence

import rerun as rr

from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import BeliefUpdated, EdgePruned
from ltvn_core.nav import events as ev
from ltvn_core.recording import schema, wording
from ltvn_core.recording.drawing import GRAPH_M, Drawn
from ltvn_core.recording.places import Places
from ltvn_core.types import FrameId, NodeId

_PLAN_M = 0.10
_PLAN, _GOAL, _HERE, _SUBGOAL = [240, 228, 66], [230, 60, 180], [255, 255, 255], [86, 180, 233]
_PRUNED = [200, 30, 30]
CURVES = 24
"""So many edges get a curve of their own; thousands of entities would make every viewer crawl."""


def drawn(event: ev.Event, places: Places) -> list[Drawn]:
    """Draw one event."""
    return [*_log_line(event), *_shapes(event, places)]


class BeliefCurves:
    """Plots p of the first edges that are driven or pruned, one curve each."""

    def __init__(self) -> None:
        self._edges: set[tuple[NodeId, NodeId]] = set()

    def begun(self, event: ev.Event) -> list[Drawn]:
        """Return the static name of a curve when the event begins one."""
        edge = _changed_edge(event)
        if edge is None or edge in self._edges or len(self._edges) >= CURVES:
            return []
        self._edges.add(edge)
        name = f"{edge[0]} → {edge[1]}"
        line = rr.SeriesLines(names=[name], widths=2, interpolation_mode="StepAfter")
        # Most edges are driven once, and a line through one point cannot be seen.
        points = rr.SeriesPoints(names=[name], markers="Circle", marker_sizes=4)
        return [Drawn(_curve(edge), [line, points])]

    def continued(self, event: ev.Event) -> list[Drawn]:
        """Return the new point of a curve; a pruned edge ends at zero."""
        edge = _changed_edge(event)
        if edge is None or edge not in self._edges:
            return []
        delta = event.delta if isinstance(event, ev.GraphChanged) else None
        return [Drawn(_curve(edge), [rr.Scalars(delta.belief.p if isinstance(delta, BeliefUpdated) else 0.0)])]


def _changed_edge(event: ev.Event) -> tuple[NodeId, NodeId] | None:
    match event:
        case ev.GraphChanged(delta=BeliefUpdated(source=source, target=target) | EdgePruned(source, target)):
            return source, target
    return None


def _curve(edge: tuple[NodeId, NodeId]) -> str:
    return f"{schema.BELIEFS}/{edge[0]}_{edge[1]}"


def _log_line(event: ev.Event) -> list[Drawn]:
    text = wording.line(event)
    return [] if text is None else [Drawn(schema.LOG, [rr.TextLog(text, level=str(wording.severity_of(event)))])]


def _shapes(event: ev.Event, places: Places) -> list[Drawn]:
    match event:
        case ev.StateChanged(state=state):
            return [Drawn(schema.STATE, [rr.StateChange(state=str(state))])]
        case ev.QueryStarted(goal=goal):
            # The last plan stays until the next query, so that the end of a recording shows it.
            return [_strip(schema.PLAN, [], places, _PLAN), _dots(schema.GOAL, [goal], places, _GOAL, radius_m=0.15)]
        case ev.Localised(node=node):
            here = _dots(schema.LOCALISED, [] if node is None else [node], places, _HERE, radius_m=0.08)
            return [here, *_margin(event)]
        case ev.Planned(nodes=nodes):
            return [_strip(schema.PLAN, nodes, places, _PLAN)]
        case ev.LegStarted():
            return _subgoal(event, places)
        case ev.LegEnded():
            return [Drawn(schema.WAYPOINT, [rr.Arrows3D(origins=[], vectors=[])])]
        case ev.GraphChanged(delta=EdgePruned(source=source, target=target)):
            return [_strip(schema.PRUNED, [source, target], places, _PRUNED)]
    return []


def _margin(event: ev.Localised) -> list[Drawn]:
    return [Drawn(schema.MARGIN, [rr.Scalars(event.margin)])] if math.isfinite(event.margin) else []


def _subgoal(event: ev.LegStarted, places: Places) -> list[Drawn]:
    departure = places.pose(event.frame)
    if departure is None:
        return []
    x, y, yaw = compose(departure, event.waypoint).tolist()  # pyright: ignore[reportArgumentType]
    arrow = rr.Arrows3D(
        origins=[[x, y, _PLAN_M]],
        vectors=[[0.3 * math.cos(yaw), 0.3 * math.sin(yaw), 0.0]],
        radii=0.025,
        colors=[_SUBGOAL],
    )
    return [Drawn(schema.WAYPOINT, [arrow])]


def _dots(entity: str, frames: Sequence[FrameId], places: Places, colour: list[int], *, radius_m: float) -> Drawn:
    return Drawn(entity, [rr.Points3D(places.points(frames, _PLAN_M), radii=radius_m, colors=[colour])])


def _strip(entity: str, frames: Sequence[FrameId], places: Places, colour: list[int]) -> Drawn:
    points = places.points(frames, _PLAN_M if entity == schema.PLAN else GRAPH_M)
    return Drawn(entity, [rr.LineStrips3D([points] if len(points) > 1 else [], radii=0.03, colors=[colour])])
