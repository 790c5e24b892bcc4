"""Where a change puts something solid, as an upright box, and how far that is from a place."""

import math
from typing import assert_never

from ltvn_core.simulation.changes.door_leaves import leaf_outline
from ltvn_core.simulation.changes.people_shapes import person_outline
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_parts import FurniturePiece
from ltvn_core.worlds import world_change as w

_FURNITURE_HEIGHT_M = 1.0


def outline_of(change: w.WorldChange, base: Scene) -> w.Outline | None:
    """Return where a door, thing or person stands after a change in a scene; None where nothing does."""
    match change:
        case w.DoorMoved(door, is_open):
            return None if is_open else leaf_outline(base.parts.doors[door])
        case w.ThingPlaced(thing, kind, (x, y, yaw), (width, depth, height)):
            if kind is w.ThingKind.FURNITURE:
                piece = own_piece(base, thing)
                width, depth = piece.width, piece.depth
            return w.Outline(x=x, y=y, yaw=yaw, width=width, depth=depth, height=height)
        case w.ThingReturned(thing):
            piece = own_piece(base, thing)
            return w.Outline(
                x=piece.x,
                y=piece.y,
                yaw=piece.yaw_rad,
                width=piece.width,
                depth=piece.depth,
                height=_FURNITURE_HEIGHT_M,
            )
        case w.PersonMoved():
            return person_outline(change)
        case w.ThingRemoved() | w.PersonLeft() | w.LightChanged() | w.PicturesExchanged() | w.TimePassed():
            return None
        case _:
            assert_never(change)


def own_piece(base: Scene, thing: str) -> FurniturePiece:
    """Return the piece of a scene's own furniture that `thing` names."""
    return next(piece for piece in base.parts.furniture if w.OWN_PREFIX + piece.name == thing)


def distance_m(outline: w.Outline, x: float, y: float) -> float:
    """Return how far a place is from an outline in metres; 0 within it."""
    cos, sin = math.cos(outline.yaw), math.sin(outline.yaw)
    ahead, aside = x - outline.x, y - outline.y
    across = max(abs(cos * ahead + sin * aside) - outline.width / 2, 0.0)
    along = max(abs(cos * aside - sin * ahead) - outline.depth / 2, 0.0)
    return math.hypot(across, along)
