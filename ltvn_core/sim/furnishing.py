"""Which furniture stands in a room, and where.

Owns the choice and the placing; a piece goes where it fits, keeps doorways clear and leaves free floor in one piece.
"""

from collections.abc import Sequence

from ltvn_core.sim import furniture as f
from ltvn_core.sim.builder import SurfaceBuilder
from ltvn_core.sim.dice import Dice
from ltvn_core.sim.floorplan import STEP_M, Room, RoomKind
from ltvn_core.sim.footprint import Footprint, Rectangle
from ltvn_core.sim.furniture import Carpenter, Piece, Spot
from ltvn_core.sim.style import Household
from ltvn_core.sim.walls import Side

_TRIES = 14

WISHES: dict[RoomKind, Sequence[Piece]] = {
    RoomKind.HALL: (f.CHEST, f.PLANT, f.LAMP),
    RoomKind.LIVING: (f.SOFA, f.TELEVISION, f.LOW_TABLE, f.SHELF, f.ARMCHAIR, f.PLANT, f.LAMP, f.SHELF, f.CHEST),
    RoomKind.KITCHEN: (f.COUNTER, f.FRIDGE, f.HIGH_TABLE, f.CHEST, f.PLANT),
    RoomKind.DINING: (f.HIGH_TABLE, f.CHEST, f.SHELF, f.PLANT, f.LAMP),
    RoomKind.BEDROOM: (f.BED, f.WARDROBE, f.CHEST, f.LAMP, f.PLANT),
    RoomKind.NURSERY: (f.BED, f.TOY_CHEST, f.SHELF, f.DESK, f.TOY_CHEST),
    RoomKind.STUDY: (f.DESK, f.SHELF, f.SHELF, f.ARMCHAIR, f.PLANT),
    RoomKind.LIBRARY: (f.SHELF, f.SHELF, f.SHELF, f.ARMCHAIR, f.LOW_TABLE, f.LAMP),
    RoomKind.BATH: (f.BATHTUB, f.TOILET, f.BASIN),
}


class Furnisher:
    """Fills rooms."""

    def __init__(self, builder: SurfaceBuilder, footprint: Footprint, household: Household) -> None:
        self._builder, self._footprint, self._household = builder, footprint, household

    def furnish(self, dice: Dice, room: Room, sides: Sequence[Side]) -> list[list[tuple[float, float]]]:
        """Place what fits of the room's wishes; return the stretches of each wall that tall pieces hide."""
        hidden: list[list[tuple[float, float]]] = [[] for _ in sides]
        wood, cloth = dice.pick(self._household.woods), dice.pick(self._household.cloths)
        for piece in WISHES[room.kind]:
            width, depth = dice.snapped(*piece.width), dice.snapped(*piece.depth)
            spot, wall, stretch = self._place(dice, room, sides, piece, width, depth)
            if spot is None:
                continue
            piece.draw(Carpenter(self._builder, spot, dice, self._household, wood, cloth))
            if piece.tall and wall is not None:
                hidden[wall].append(stretch)
        return hidden

    def _place(
        self, dice: Dice, room: Room, sides: Sequence[Side], piece: Piece, width: float, depth: float
    ) -> tuple[Spot | None, int | None, tuple[float, float]]:
        for _ in range(_TRIES):
            if piece.against_wall:
                wall = dice.index(len(sides))
                spot, area = _beside(dice, sides[wall], width, depth)
            else:
                wall = None
                spot, area = _within(dice, room, width, depth)
            if spot is not None and area is not None and self._footprint.try_block(area):
                return spot, wall, _stretch(spot, None if wall is None else sides[wall], width)
        return None, None, (0.0, 0.0)


def _beside(dice: Dice, side: Side, width: float, depth: float) -> tuple[Spot | None, Rectangle | None]:
    """Find a place with its back to a wall."""
    inset = 0.05  # The half wall of the neighbouring walls.
    low_end, high_end = side.low + inset, side.high - inset - width
    if high_end < low_end:
        return None, None
    low = dice.snapped(low_end, high_end, STEP_M)
    near = side.face
    far = near + side.inward * depth
    middle, along = (near + far) / 2, low + width / 2
    a, b = sorted((near, far))
    if side.axis == 0:
        turn = (0.0, -1.0) if side.inward > 0 else (0.0, 1.0)
        return Spot(middle, along, turn, width, depth), Rectangle(a, low, b, low + width)
    turn = (1.0, 0.0) if side.inward > 0 else (-1.0, 0.0)
    return Spot(along, middle, turn, width, depth), Rectangle(low, a, low + width, b)


def _within(dice: Dice, room: Room, width: float, depth: float) -> tuple[Spot | None, Rectangle | None]:
    """Find a place away from the walls."""
    turned = dice.chance(0.5)
    across, down = (depth, width) if turned else (width, depth)
    margin = 0.6
    if room.x1 - room.x0 < across + 2 * margin or room.y1 - room.y0 < down + 2 * margin:
        return None, None
    x0 = dice.snapped(room.x0 + margin, room.x1 - margin - across, STEP_M)
    y0 = dice.snapped(room.y0 + margin, room.y1 - margin - down, STEP_M)
    turn = (0.0, 1.0) if turned else dice.pick(((1.0, 0.0), (-1.0, 0.0)))
    spot = Spot(x0 + across / 2, y0 + down / 2, turn, width, depth)
    return spot, Rectangle(x0, y0, x0 + across, y0 + down)


def _stretch(spot: Spot, side: Side | None, width: float) -> tuple[float, float]:
    if side is None:
        return 0.0, 0.0
    along = spot.y if side.axis == 0 else spot.x
    return along - width / 2, along + width / 2
