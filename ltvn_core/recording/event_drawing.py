"""What events look like in the Rerun viewer: plan, goal, subgoal, pruned edges, a changed world, state and log.

Pure functions; owns shapes, and takes colours from `ltvn_core.palette`. Beliefs of edges are drawn in `belief_drawing`.
"""

import math
import re
from collections.abc import Sequence
from typing import assert_never

import rerun as rr

from ltvn_core import palette
from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import BULK_CAUSES, Cause, EdgePruned
from ltvn_core.navigation import events as ev
from ltvn_core.navigation.event_text import describe_event
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.palette import Rgb8
from ltvn_core.recording import schema
from ltvn_core.recording.drawn_poses import DrawnPoses
from ltvn_core.recording.map_drawing import GRAPH_HEIGHT_M, DrawnEntity
from ltvn_core.types import FrameId
from ltvn_core.worlds import world_change as w
from ltvn_core.worlds.world_change import PersonMoved

_PLAN_HEIGHT_M = 0.10
_QUIET_CAUSES = (*BULK_CAUSES, Cause.ONLINE)
"""A map that is built or loaded makes thousands of changes; the log leaves them out."""


def draw_world_change(event: WorldChanged) -> list[DrawnEntity]:
    """Draw where something stands now, or take its box away where it stands no more."""
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
        labels=[label],
        show_labels=False,
    )


def draw_event(event: ev.Event, drawn_poses: DrawnPoses) -> list[DrawnEntity]:
    """Draw one event."""
    return [*_log_line(event), *_shapes(event, drawn_poses)]


def _log_line(event: ev.Event) -> list[DrawnEntity]:
    if isinstance(event, ev.WorldChanged) and isinstance(event.change, PersonMoved):
        return []  # Somebody who walks would fill the log.
    if isinstance(event, ev.StateChanged) or (
        isinstance(event, ev.GraphChanged) and event.delta.cause in _QUIET_CAUSES
    ):
        return []
    description = describe_event(event)
    return [DrawnEntity(schema.LOG, [rr.TextLog(description.text, level=str(description.severity))])]


def _shapes(event: ev.Event, drawn_poses: DrawnPoses) -> list[DrawnEntity]:
    match event:
        case ev.StateChanged(state=state):
            return [DrawnEntity(schema.STATE, [rr.StateChange(state=str(state))])]
        case ev.QueryStarted(goal=goal):
            # The last plan stays until the next query, so that the end of a recording shows it.
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
        case ev.GraphChanged() | ev.Collided() | ev.QueryEnded() | ev.Judged() | ev.Note():
            return []
    assert_never(event)


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
