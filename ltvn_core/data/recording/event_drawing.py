"""Draws events for the Rerun viewer: plan, goal, subgoal, pruned edges, a changed world, state, log, beliefs.

Every edge that is planned, driven or pruned gets its own curve, which begins with the edge's first belief. A table
lists the edges of the current plan and the latest changes. Owns the shapes and the choice of these edges; takes colours
from `ltvn_core.palette`.
"""

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import rerun as rr

from ltvn_core import palette
from ltvn_core import worlds as w
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.map_drawing import GRAPH_HEIGHT_M, DrawnEntity
from ltvn_core.data.recording.schema import RowTime
from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import BULK_CAUSES, Belief, BeliefUpdated, Cause, EdgeAdded, EdgePruned
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as ev
from ltvn_core.navigation.event_table import describe_event
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.palette import Rgb8
from ltvn_core.readable_text import readable
from ltvn_core.types import FrameId
from ltvn_core.worlds import PersonMoved

_PLAN_HEIGHT_M = 0.10
_QUIET_CAUSES = (*BULK_CAUSES, Cause.ONLINE)
"""Causes of changes that are left out of the log, because building or loading a map makes thousands of them."""
LAST_CHANGED = 8
"""Number of changed edges in the table."""
PLANNED_EDGES = 12
"""Number of edges of the plan in the table, starting at the robot's position."""


def draw_world_change(event: WorldChanged) -> list[DrawnEntity]:
    """Draw a thing at its place, or remove its box if it is gone."""
    named = _entity(event.change)
    if named is None:
        return []
    name, colour = named
    entity = f"{schema.CHANGES}/{re.sub('[^a-zA-Z0-9_-]', '_', name)}"
    if event.outline is None:
        return [DrawnEntity(entity, [rr.Boxes3D(half_sizes=[])])]
    return [DrawnEntity(entity, [_box(event.outline, colour, name)])]


def _entity(change: w.WorldChange) -> tuple[str, Rgb8] | None:
    match change:
        case w.DoorMoved(door):
            return f"door {door}", palette.EDGE_REMOVED
        case w.ThingPlaced(thing) | w.ThingRemoved(thing) | w.ThingReturned(thing):
            return thing, palette.GOAL
        case w.PersonMoved(person) | w.PersonLeft(person):
            return person, palette.PREDICTED_POSE
        case w.LightChanged() | w.PicturesExchanged() | w.TimePassed():
            return None


def _box(outline: w.Outline, colour: Rgb8, label: str) -> rr.Boxes3D:
    return rr.Boxes3D(
        centers=[[outline.x, outline.y, outline.height / 2]],
        half_sizes=[[outline.width / 2, outline.depth / 2, outline.height / 2]],
        quaternions=[rr.Quaternion(xyzw=[0.0, 0.0, math.sin(outline.yaw / 2), math.cos(outline.yaw / 2)])],
        colors=[colour],
        labels=[readable(label)],
        show_labels=False,
    )


def draw_event(event: ev.Event, drawn_poses: DrawnPoses) -> list[DrawnEntity]:
    """Draw one event."""
    return [*_log_line(event), *_shapes(event, drawn_poses)]


def _log_line(event: ev.Event) -> list[DrawnEntity]:
    if isinstance(event, ev.WorldChanged) and isinstance(event.change, PersonMoved):
        return []  # A walking person would flood the log.
    if isinstance(event, ev.StateChanged) or (
        isinstance(event, ev.GraphChanged) and event.delta.cause in _QUIET_CAUSES
    ):
        return []
    description = describe_event(event)
    return [DrawnEntity(schema.LOG, [rr.TextLog(readable(description.text), level=str(description.severity))])]


def _shapes(event: ev.Event, drawn_poses: DrawnPoses) -> list[DrawnEntity]:
    match event:
        case ev.StateChanged(state=state):
            return [DrawnEntity(schema.STATE, [rr.StateChange(state=str(state))])]
        case ev.QueryStarted(goal=goal):
            # The last plan stays until the next query, so that it is drawn at the end of a recording.
            return [
                _strip(schema.PLAN, [], drawn_poses, palette.PLAN),
                _dots(schema.GOAL, [goal], drawn_poses, palette.GOAL, radius_m=0.15),
            ]
        case ev.Localised(node=node):
            here = _dots(
                schema.LOCALISED, [] if node is None else [node], drawn_poses, palette.LOCALISED, radius_m=0.08
            )
            return [here, *_margin(event)]
        case ev.Planned(nodes=nodes):
            return [_strip(schema.PLAN, nodes, drawn_poses, palette.PLAN)]
        case ev.AttemptStarted():
            return _subgoal(event, drawn_poses)
        case ev.AttemptEnded():
            return [DrawnEntity(schema.WAYPOINT, [rr.Arrows3D(origins=[], vectors=[])])]
        case ev.GraphChanged(delta=EdgePruned(source=source, target=target)):
            return [_strip(schema.PRUNED, [source, target], drawn_poses, palette.EDGE_REMOVED)]
        case ev.WorldChanged():
            return draw_world_change(event)
        case _:
            return []  # Its line in the log is enough.


def _margin(event: ev.Localised) -> list[DrawnEntity]:
    return [DrawnEntity(schema.MARGIN, [rr.Scalars(event.margin)])] if math.isfinite(event.margin) else []


def _subgoal(event: ev.AttemptStarted, drawn_poses: DrawnPoses) -> list[DrawnEntity]:
    departure = drawn_poses.pose(event.frame)
    if departure is None:
        return []
    x, y, yaw = compose(departure, event.waypoint).tolist()  # pyright: ignore[reportArgumentType]
    arrow = rr.Arrows3D(
        origins=[[x, y, _PLAN_HEIGHT_M]],
        vectors=[[0.3 * math.cos(yaw), 0.3 * math.sin(yaw), 0.0]],
        radii=0.025,
        colors=[palette.PREDICTED_POSE],
    )
    return [DrawnEntity(schema.WAYPOINT, [arrow])]


def _dots(
    entity: str, frames: Sequence[FrameId], drawn_poses: DrawnPoses, colour: Rgb8, *, radius_m: float
) -> DrawnEntity:
    return DrawnEntity(
        entity, [rr.Points3D(drawn_poses.points(frames, _PLAN_HEIGHT_M), radii=radius_m, colors=[colour])]
    )


def _strip(entity: str, frames: Sequence[FrameId], drawn_poses: DrawnPoses, colour: Rgb8) -> DrawnEntity:
    points = drawn_poses.points(frames, _PLAN_HEIGHT_M if entity == schema.PLAN else GRAPH_HEIGHT_M)
    return DrawnEntity(entity, [rr.LineStrips3D([points] if len(points) > 1 else [], radii=0.03, colors=[colour])])


class _Change(NamedTuple):
    edge: EdgeKey
    before: Belief | None
    after: Belief | None
    """New belief; None if the edge was pruned."""


class BeliefDrawing:
    """Follows the beliefs of all edges and draws those that are planned, driven or pruned."""

    def __init__(self) -> None:
        self._newest: dict[EdgeKey, tuple[RowTime, Belief]] = {}
        self._curves: set[EdgeKey] = set()
        self._plan: tuple[EdgeKey, ...] = ()
        self._changed: dict[EdgeKey, _Change] = {}
        """The edges that changed most recently, the newest at the end."""

    @property
    def shown_edges(self) -> Sequence[EdgeKey]:
        """The edges of the current plan and the most recently changed ones, each once."""
        return list(dict.fromkeys((*self._plan[:PLANNED_EDGES], *reversed(self._changed))))

    def draw(self, event: ev.Event, time: RowTime) -> Iterator[DrawnEntity]:
        """Yield the rows that an event adds to the curves and the table."""
        match event:
            case ev.QueryStarted():
                self._plan = ()
                yield self._table(time)
            case ev.Planned(nodes=nodes):
                self._plan = tuple(pairwise(nodes))
                for edge in self._plan:
                    yield from self._begin_curve(edge)
                yield self._table(time)
            case ev.GraphChanged(delta=EdgeAdded(edge=edge)):
                key = (edge.source, edge.target)
                self._newest[key] = time, edge.belief
                if key in self._curves:  # The edge was pruned and is added again.
                    yield from _points(key, time, edge.belief)
            case ev.GraphChanged(delta=BeliefUpdated(source=source, target=target, belief=belief)):
                yield from self._change((source, target), belief, time)
            case ev.GraphChanged(delta=EdgePruned(source=source, target=target)):
                yield from self._change((source, target), None, time)
            case _:
                pass

    def _change(self, edge: EdgeKey, after: Belief | None, time: RowTime) -> Iterator[DrawnEntity]:
        yield from self._begin_curve(edge)
        before = self._newest[edge][1] if edge in self._newest else None
        if after is None:
            self._newest.pop(edge, None)
        else:
            self._newest[edge] = time, after
        self._changed.pop(edge, None)
        self._changed[edge] = _Change(edge, before, after)
        if len(self._changed) > LAST_CHANGED:
            self._changed.pop(next(iter(self._changed)))
        yield from _points(edge, time, after or Belief(0.0, math.nan, math.nan))
        yield self._table(time)

    def _begin_curve(self, edge: EdgeKey) -> Iterator[DrawnEntity]:
        """Yield the first point of an edge's curves, unless they have been started.

        Curves have no styles of their own, because each style would add a kilobyte to Rerun's table of chunks.
        """
        if edge in self._curves:
            return
        self._curves.add(edge)
        if edge in self._newest:
            yield from _points(edge, *self._newest[edge])

    def _table(self, time: RowTime) -> DrawnEntity:
        planned = [f"| {_name(edge)} | {self._belief_cells(edge)} |" for edge in self._plan[:PLANNED_EDGES]]
        left_out = len(self._plan) - len(planned)
        changed = [_changed_row(change) for change in reversed(self._changed.values())]
        lines = [
            *_section("Current plan", planned),
            *([f"and {left_out} more"] if left_out else []),
            "",
            *_section("Changed last", changed),
        ]
        text = rr.TextDocument("\n".join(lines), media_type=rr.MediaType.MARKDOWN)
        return DrawnEntity(schema.BELIEF_TABLE, [text], time)

    def _belief_cells(self, edge: EdgeKey) -> str:
        if edge not in self._newest:
            return "– | –"
        belief = self._newest[edge][1]
        return f"{belief.p:.2f} | {_length(belief)}"


def probability_entity(edge: EdgeKey) -> str:
    """Return the entity that holds p of an edge."""
    return f"{schema.PROBABILITIES}/{edge[0]}_{edge[1]}"


def length_entity(edge: EdgeKey) -> str:
    """Return the entity that holds mu and sigma of an edge."""
    return f"{schema.LENGTHS}/{edge[0]}_{edge[1]}"


def _points(edge: EdgeKey, time: RowTime, belief: Belief) -> Iterator[DrawnEntity]:
    yield DrawnEntity(probability_entity(edge), [rr.Scalars(belief.p)], time)
    yield DrawnEntity(length_entity(edge), [rr.Scalars([belief.mu, math.sqrt(belief.sigma2)])], time)


def _section(title: str, rows: Sequence[str]) -> list[str]:
    return [f"**{title}**", "", *(["| edge | p | μ ± σ |", "|:--|--:|--:|", *rows] if rows else ["none"])]


def _changed_row(change: _Change) -> str:
    before = "" if change.before is None else f"{change.before.p:.2f} → "
    if change.after is None:
        return f"| {_name(change.edge)} | {before}pruned | – |"
    return f"| {_name(change.edge)} | {before}**{change.after.p:.2f}** | {_length(change.after)} |"


def _length(belief: Belief) -> str:
    return f"{belief.mu:.2f} ± {math.sqrt(belief.sigma2):.2f}"


def _name(edge: EdgeKey) -> str:
    return f"{edge[0]} → {edge[1]}"
