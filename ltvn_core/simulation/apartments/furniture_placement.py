"""Chooses and places the furniture of rooms.

A piece is placed where it fits, keeps doorways clear and leaves the free floor connected.
"""

from collections.abc import Sequence

from ltvn_core.simulation.apartments import furniture as f
from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, FloorRectangle, OccupancyGrid
from ltvn_core.simulation.apartments.furniture import FurnitureBuilder, FurnitureKind, FurniturePlacement
from ltvn_core.simulation.apartments.materials import ApartmentMaterials
from ltvn_core.simulation.apartments.room_shell import WallSide
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import FurniturePiece, Room, RoomKind
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_TRIES = 14
"""Number of random placements that are tried for a piece before it is left out."""

FURNITURE_BY_ROOM_KIND: dict[RoomKind, Sequence[FurnitureKind]] = {
    RoomKind.HALL: (f.CHEST, f.PLANT, f.LAMP),
    RoomKind.LIVING: (f.SOFA, f.TELEVISION, f.LOW_TABLE, f.SHELF, f.ARMCHAIR, f.PLANT, f.LAMP, f.SHELF, f.CHEST),
    RoomKind.KITCHEN: (f.COUNTER, f.FRIDGE, f.HIGH_TABLE, f.CHEST, f.PLANT),
    RoomKind.DINING: (f.HIGH_TABLE, f.CHEST, f.SHELF, f.PLANT, f.LAMP),
    RoomKind.BEDROOM: (f.BED, f.WARDROBE, f.CHEST, f.LAMP, f.PLANT),
    RoomKind.NURSERY: (f.BED, f.TOY_CHEST, f.SHELF, f.DESK, f.TOY_CHEST),
    RoomKind.STUDY: (f.DESK, f.SHELF, f.SHELF, f.ARMCHAIR, f.PLANT),
    RoomKind.LIBRARY: (f.SHELF, f.SHELF, f.SHELF, f.ARMCHAIR, f.LOW_TABLE, f.LAMP),
    RoomKind.BATH: (f.BATHTUB, f.TOILET, f.BASIN),
    RoomKind.MEETING: (f.TABLE_WITH_CHAIRS, f.TELEVISION, f.PLANT, f.CHEST),
}


class FurniturePlacer:
    """Furnishes the rooms of one apartment."""

    def __init__(self, builder: SurfaceBuilder, occupancy: OccupancyGrid, materials: ApartmentMaterials) -> None:
        self._builder = builder
        self._occupancy = occupancy
        self._materials = materials
        self.placed: list[FurniturePiece] = []
        """Pieces placed so far, in all rooms."""

    def place_furniture(self, rng: SeededRng, room: Room, sides: Sequence[WallSide]) -> list[list[tuple[float, float]]]:
        """Place the furniture that belongs to a room's kind; pieces that do not fit are left out.

        Returns:
            For each of the `sides`, the intervals (low, high) along the wall that tall pieces hide.
        """
        hidden: list[list[tuple[float, float]]] = [[] for _ in sides]
        wood = rng.choice(self._materials.woods)
        cloth = rng.choice(self._materials.cloths)
        for piece in FURNITURE_BY_ROOM_KIND[room.kind]:
            width = rng.uniform_multiple(*piece.width)
            depth = rng.uniform_multiple(*piece.depth)
            placement, wall, wall_interval = self._place(rng, room, sides, piece, width, depth)
            if placement is None:
                continue
            self._build(rng, piece, placement, wood=wood, cloth=cloth)
            if piece.tall and wall is not None:
                hidden[wall].append(wall_interval)
        return hidden

    def place_at(self, rng: SeededRng, kind: FurnitureKind, placement: FurniturePlacement) -> None:
        """Place one piece at a given place, without any check."""
        wood = rng.choice(self._materials.woods)
        cloth = rng.choice(self._materials.cloths)
        self._occupancy.block(_footprint(placement))
        self._build(rng, kind, placement, wood=wood, cloth=cloth)

    def _build(
        self,
        rng: SeededRng,
        kind: FurnitureKind,
        placement: FurniturePlacement,
        *,
        wood: TextureIndex,
        cloth: TextureIndex,
    ) -> None:
        first_face = self._builder.face_count
        kind.draw(
            FurnitureBuilder(
                builder=self._builder,
                placement=placement,
                rng=rng,
                materials=self._materials,
                wood=wood,
                cloth=cloth,
            )
        )
        self._note(kind, placement, first_face)

    def _note(self, kind: FurnitureKind, placement: FurniturePlacement, first_face: int) -> None:
        number = sum(piece.name.startswith(f"{kind.name}-") for piece in self.placed)
        self.placed.append(
            FurniturePiece(
                name=f"{kind.name}-{number}",
                x=placement.x,
                y=placement.y,
                turn=placement.turn,
                width=placement.width,
                depth=placement.depth,
                first_face=first_face,
                end_face=self._builder.face_count,
            )
        )

    def _place(
        self, rng: SeededRng, room: Room, sides: Sequence[WallSide], piece: FurnitureKind, width: float, depth: float
    ) -> tuple[FurniturePlacement | None, int | None, tuple[float, float]]:
        for _ in range(_TRIES):
            if piece.against_wall:
                wall = rng.index(len(sides))
                placement, area = _beside(rng, sides[wall], width, depth)
            else:
                wall = None
                placement, area = _within(rng, room, width, depth)
            if placement is not None and area is not None and self._occupancy.try_block(area):
                return placement, wall, _wall_interval(placement, None if wall is None else sides[wall], width)
        return None, None, (0.0, 0.0)


def _footprint(placement: FurniturePlacement) -> FloorRectangle:
    """Return the rectangle of a piece that is turned by a multiple of a right angle."""
    lies_along_x = abs(placement.turn[0]) > 0.5
    across, down = (placement.width, placement.depth) if lies_along_x else (placement.depth, placement.width)
    return FloorRectangle(
        x0=placement.x - across / 2,
        y0=placement.y - down / 2,
        x1=placement.x + across / 2,
        y1=placement.y + down / 2,
    )


def _beside(
    rng: SeededRng, side: WallSide, width: float, depth: float
) -> tuple[FurniturePlacement | None, FloorRectangle | None]:
    """Draw a placement with its back to a wall, and the rectangle that it needs; None if the wall is too short."""
    inset = 0.05  # Half the thickness of the neighbouring walls.
    low_end = side.low + inset
    high_end = side.high - inset - width
    if high_end < low_end:
        return None, None
    low = rng.uniform_multiple(low_end, high_end, GRID_STEP_M)
    near = side.face
    far = near + side.inward * depth
    middle = (near + far) / 2
    along = low + width / 2
    a, b = sorted((near, far))
    if side.axis == 0:
        turn = (0.0, -1.0) if side.inward > 0 else (0.0, 1.0)
        placement = FurniturePlacement(x=middle, y=along, turn=turn, width=width, depth=depth)
        return placement, FloorRectangle(x0=a, y0=low, x1=b, y1=low + width)
    turn = (1.0, 0.0) if side.inward > 0 else (-1.0, 0.0)
    placement = FurniturePlacement(x=along, y=middle, turn=turn, width=width, depth=depth)
    return placement, FloorRectangle(x0=low, y0=a, x1=low + width, y1=b)


def _within(
    rng: SeededRng, room: Room, width: float, depth: float
) -> tuple[FurniturePlacement | None, FloorRectangle | None]:
    """Draw a placement away from the walls, and the rectangle that it needs; None if the room is too small."""
    turned = rng.chance(0.5)
    across, down = (depth, width) if turned else (width, depth)
    margin = 0.6
    if room.x1 - room.x0 < across + 2 * margin or room.y1 - room.y0 < down + 2 * margin:
        return None, None
    x0 = rng.uniform_multiple(room.x0 + margin, room.x1 - margin - across, GRID_STEP_M)
    y0 = rng.uniform_multiple(room.y0 + margin, room.y1 - margin - down, GRID_STEP_M)
    turn = (0.0, 1.0) if turned else rng.choice(((1.0, 0.0), (-1.0, 0.0)))
    placement = FurniturePlacement(x=x0 + across / 2, y=y0 + down / 2, turn=turn, width=width, depth=depth)
    return placement, FloorRectangle(x0=x0, y0=y0, x1=x0 + across, y1=y0 + down)


def _wall_interval(placement: FurniturePlacement, side: WallSide | None, width: float) -> tuple[float, float]:
    if side is None:
        return 0.0, 0.0
    along = placement.y if side.axis == 0 else placement.x
    return along - width / 2, along + width / 2
