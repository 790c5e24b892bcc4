"""What a changed world looks like in the Rerun viewer: a box for each closed door, thing and person."""

import math
import re

import rerun as rr

from ltvn_core import palette
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.palette import Rgb8
from ltvn_core.recording import schema
from ltvn_core.recording.map_drawing import DrawnEntity
from ltvn_core.worlds import world_change as w


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
