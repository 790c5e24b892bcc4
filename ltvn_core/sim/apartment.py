"""An apartment grown from a seed: plan, shell, furniture and what hangs on the walls.

Owns the order of work. The same seed gives the same apartment on every machine.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.sim import pictures
from ltvn_core.sim.builder import SurfaceBuilder
from ltvn_core.sim.dice import Dice
from ltvn_core.sim.floorplan import FloorPlan, Room, RoomKind, draw_plan
from ltvn_core.sim.footprint import Footprint
from ltvn_core.sim.furnishing import Furnisher
from ltvn_core.sim.standing import really_blocked
from ltvn_core.sim.style import decorate, equip
from ltvn_core.sim.surfaces import Surfaces
from ltvn_core.sim.walls import Shell, sides_of

_WITH_RUG = {RoomKind.LIVING, RoomKind.BEDROOM, RoomKind.STUDY, RoomKind.LIBRARY, RoomKind.NURSERY, RoomKind.DINING}


@dataclass(frozen=True, eq=False)
class Apartment:
    """A furnished apartment."""

    plan: FloorPlan
    surfaces: Surfaces
    blocked: NDArray[np.bool_]
    """(rows, columns) cells of 5 cm in which something stands."""
    origin: NDArray[np.float64]
    """(2,) x and y of that grid's lower corner."""


def grow(seed: int, area_m2: float) -> Apartment:
    """Grow an apartment of a floor area (45 to 130 m2)."""
    dice = Dice(np.random.default_rng(seed))
    while True:  # A plan whose empty rooms are cut off from each other is drawn again; none was met so far.
        plan = draw_plan(dice.fork(), area_m2)
        builder, footprint = SurfaceBuilder(), Footprint(plan)
        household = equip(builder, dice.fork())
        shell = Shell(builder, footprint, dice.fork(), household, round(dice.uniform(2.45, 2.75), 2))
        hues = _hues(dice.fork(), len(plan.rooms))
        styles = [decorate(builder, dice.fork(), room.kind, hue) for room, hue in zip(plan.rooms, hues, strict=True)]
        sides = [sides_of(plan, index) for index in range(len(plan.rooms))]
        for room, room_sides, style in zip(plan.rooms, sides, styles, strict=True):
            shell.draw(room, room_sides, style)
        if footprint.is_one_piece():
            break
    furnisher = Furnisher(builder, footprint, household)
    for room, room_sides in zip(plan.rooms, sides, strict=True):
        own = dice.fork()
        if room.kind in _WITH_RUG and own.chance(0.85):
            _lay_rug(builder, own, room)
        hidden = furnisher.furnish(own, room, room_sides)
        for side, covered in zip(room_sides, hidden, strict=True):
            shell.hang(room, side, covered)
    surfaces = builder.build()
    blocked = really_blocked(footprint.blocked, footprint.origin, surfaces.vertices[surfaces.faces])
    return Apartment(plan, surfaces, blocked, footprint.origin)


def _hues(dice: Dice, count: int) -> list[float]:
    """Spread hues over the rooms, so that no two of them look alike at a glance."""
    first = dice.uniform(0, 1)
    return [first + order / count for order in dice.shuffled(range(count))]


def _lay_rug(builder: SurfaceBuilder, dice: Dice, room: Room) -> None:
    width = min(room.x1 - room.x0 - 0.8, dice.uniform(1.4, 2.6))
    depth = min(room.y1 - room.y0 - 0.8, dice.uniform(1.2, 2.2))
    x = dice.uniform(room.x0 + 0.3 + width / 2, room.x1 - 0.3 - width / 2)
    y = dice.uniform(room.y0 + 0.3 + depth / 2, room.y1 - 0.3 - depth / 2)
    builder.box(builder.texture(pictures.rug(dice)), (x, y, 0.003), (width, depth, 0.006), tile_m=None)
