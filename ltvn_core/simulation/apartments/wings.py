"""Generates a repetitive office building from a seed: rows of rooms that are copies of each other.

The same seed gives the same building on every machine, as with apartments: the order of the draws is part of the
format. All offices have the same size, walls and furniture, and so do all meeting rooms. Rooms on one side of a
corridor are copies of those on the other side, rotated by 180 degrees, so that they look the same from their doors.
Only posters, in some of the rooms, distinguish them. Coordinates are as in `floor_plan`; large buildings have two
corridors, joined at both ends.

    +---+---+-------+---+---+
    |   |   |       |   |   |
    +- -+- -+- -----+- -+- -+
    |                       |
    +- -+- -+----- -+- -+- -+
    |   |   |       |   |   |
    +---+---+-------+---+---+
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments.floor_plan import FloorPlan, OccupancyGrid, snap
from ltvn_core.simulation.apartments.furniture import FurnitureKind, FurniturePlacement
from ltvn_core.simulation.apartments.furniture_placement import FURNITURE_BY_ROOM_KIND, FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import (
    RoomMaterials,
    choose_apartment_materials,
    choose_room_materials,
)
from ltvn_core.simulation.apartments.office import corridors, opening
from ltvn_core.simulation.apartments.room_shell import RoomShell, WallSide, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import Doorway, FurniturePiece, Room, RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_TWO_CORRIDORS_M2 = 800.0
_OFFICE_M = 3.2
"""Approximate width of an office in metres; a meeting room takes the place of two offices."""
_DOORWAY_M = 0.95
_HEIGHT_M = 2.7
_POSTER_SHARE = 0.25
_POSTERS_IN_CORRIDOR = 2
"""Number of posters on each wall of a corridor."""
_AROUND_M = 1.0
"""Width in metres of the free floor around the single room in which an arrangement is drawn."""
_PICTURE_M = 1.5


Pieces = tuple[tuple[FurnitureKind, FurniturePlacement], ...]
"""Furniture with its placement relative to the lower corner of a room whose door is in the wall with the least y."""
Hidden = tuple[tuple[tuple[float, float], ...], ...]
"""Intervals (low, high) of each of the four walls that tall furniture hides, from the room's lower corner."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """The furnishing that all rooms of one kind share."""

    pieces: Pieces
    hidden: Hidden
    style: RoomMaterials
    seed: int

    def draws(self) -> SeededRng:
        """Return a generator that repeats the same draws for each room."""
        return SeededRng(np.random.default_rng(self.seed))


def generate_wings_plan(rng: SeededRng, area_m2: float) -> FloorPlan:
    """Return the plan of a building with a given area (600 to 1500 m2); its corridors come first."""
    count = 1 if area_m2 < _TWO_CORRIDORS_M2 else 2
    broad = rng.uniform_multiple(1.7, 2.1)
    deep = rng.uniform_multiple(3.8, 4.2)
    depth = snap(count * (2 * deep + broad))
    inset = broad if count > 1 else 0.0
    slots = round((area_m2 / depth - 2 * inset) / _OFFICE_M)
    wide = snap((area_m2 / depth - 2 * inset) / slots)
    width = snap(slots * wide + 2 * inset)
    door_at = rng.uniform_multiple(0.4, wide - 0.4 - _DOORWAY_M)
    halls, doorways = _halls(width, depth, broad, deep, count)
    rooms: list[Room] = []
    for row, (first, size) in product(range(2 * count), _slots(slots)):
        x0 = snap(inset + first * wide)
        y0 = snap(row * deep + (row + 1) // 2 * broad)
        kind = RoomKind.STUDY if size == 1 else RoomKind.MEETING
        room = Room(kind, x0, y0, snap(x0 + size * wide), snap(y0 + deep))
        doorways.append(_doorway(room, (len(halls) + len(rooms), row // 2), door_at, turned=row % 2 == 0))
        rooms.append(room)
    return FloorPlan(width=width, depth=depth, rooms=(*halls, *rooms), doorways=tuple(doorways))


def _halls(width: float, depth: float, broad: float, deep: float, count: int) -> tuple[tuple[Room, ...], list[Doorway]]:
    """Return one corridor, or two corridors and the two corridors that join their ends, with the openings between
    them."""
    if count == 1:
        return (Room(RoomKind.HALL, 0.0, deep, width, snap(deep + broad)),), []
    halls = corridors(width, depth, broad, (deep, snap(3 * deep + broad)))
    return halls, [opening(halls, along, across) for along, across in product((0, 1), (2, 3))]


def _slots(count: int) -> list[tuple[int, int]]:
    """Return the first slot of each room in a row, and its number of slots: two for a meeting room, else one."""
    meeting = (count // 4, count - 2 - count // 4)
    taken = {first + 1 for first in meeting}
    return [(first, 2 if first in meeting else 1) for first in range(count) if first not in taken]


def _doorway(room: Room, rooms: tuple[int, int], door_at: float, *, turned: bool) -> Doorway:
    """Return the door of a room: in the wall with the least y, or with the largest y if the room is turned."""
    low = snap(room.x1 - door_at - _DOORWAY_M if turned else room.x0 + door_at)
    return Doorway(rooms=rooms, axis=1, wall=room.y1 if turned else room.y0, low=low, high=snap(low + _DOORWAY_M))


def generate_wings(seed: int, area_m2: float) -> Building:
    """Generate the building of a seed with a floor area (600 to 1500 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    plan = generate_wings_plan(rng.spawn(), area_m2)
    builder = SurfaceBuilder(share_textures=True)
    occupancy = OccupancyGrid(plan)
    materials = choose_apartment_materials(builder, rng.spawn())
    placer = FurniturePlacer(builder, occupancy, materials)
    pictures = builder.texture(decals.window_view(rng.spawn())), builder.texture(decals.painting(rng.spawn()))
    patterns = _patterns(rng.spawn(), builder, plan)
    posters = RoomShell(builder, occupancy, rng.spawn(), materials, _HEIGHT_M)
    for number, room in enumerate(plan.rooms):
        pattern = patterns[room.kind]
        sides = _sides(plan, number)
        shell = RoomShell(builder, occupancy, pattern.draws(), materials, _HEIGHT_M)
        shell.draw(room, sides, pattern.style)
        for kind, placement in pattern.pieces:
            placer.place_at(pattern.draws(), kind, _placed(placement, room, turned=_is_turned(plan, number)))
        if room.kind is not RoomKind.HALL:
            _hang_picture(shell, sides[3], pictures)
        _hang_posters(posters, rng, pattern, room, sides)
    parts = SceneParts(
        doorways=plan.doorways, furniture=tuple(placer.placed), paintings=tuple(posters.paintings), rugs=()
    )
    return finished_building(plan, builder, occupancy, parts)


def _patterns(rng: SeededRng, builder: SurfaceBuilder, plan: FloorPlan) -> dict[RoomKind, Pattern]:
    """Return the pattern of each kind of room."""
    patterns: dict[RoomKind, Pattern] = {}
    hue = rng.uniform(0, 1)
    for shift, kind in enumerate((RoomKind.HALL, RoomKind.STUDY, RoomKind.MEETING)):
        number = next(k for k, room in enumerate(plan.rooms) if room.kind is kind and not _is_turned(plan, k))
        style = choose_room_materials(builder, rng.spawn(), kind, hue + shift / 3)
        pieces, hidden = _arrangement(rng.spawn(), plan, number)
        patterns[kind] = Pattern(pieces=pieces, hidden=hidden, style=style, seed=rng.index(2**32))
    return patterns


def _arrangement(rng: SeededRng, plan: FloorPlan, number: int) -> tuple[Pieces, Hidden]:
    """Furnish a single copy of a room, and return the furniture and the intervals of each wall that it hides."""
    kind = plan.rooms[number].kind
    if kind is RoomKind.HALL:
        return (), ((), (), (), ())
    alone = _alone(plan, number)
    builder = SurfaceBuilder()
    occupancy = OccupancyGrid(alone)
    materials = choose_apartment_materials(builder, rng.spawn())
    style = choose_room_materials(builder, rng.spawn(), kind, 0.0)
    sides = wall_sides(alone, 0)
    RoomShell(builder, occupancy, rng.spawn(), materials, _HEIGHT_M).draw(alone.rooms[0], sides, style)
    placer = FurniturePlacer(builder, occupancy, materials)
    hidden = placer.place_furniture(rng.spawn(), alone.rooms[0], sides)
    kinds = {kind.name: kind for kind in FURNITURE_BY_ROOM_KIND[kind]}
    pieces = tuple((kinds[piece.name.rpartition("-")[0]], _from_corner(piece)) for piece in placer.placed)
    return pieces, tuple(tuple((low - _AROUND_M, high - _AROUND_M) for low, high in wall) for wall in hidden)


def _alone(plan: FloorPlan, number: int) -> FloorPlan:
    """Return a plan of one room with free floor around it, so that all its walls are inner walls."""
    room = plan.rooms[number]
    door = next(door for door in plan.doorways if number in door.rooms)
    width = snap(room.x1 - room.x0)
    depth = snap(room.y1 - room.y0)
    low = snap(door.low - room.x0 + _AROUND_M)
    return FloorPlan(
        width=snap(width + 2 * _AROUND_M),
        depth=snap(depth + 2 * _AROUND_M),
        rooms=(Room(room.kind, _AROUND_M, _AROUND_M, snap(width + _AROUND_M), snap(depth + _AROUND_M)),),
        doorways=(Doorway(rooms=(0, 0), axis=1, wall=_AROUND_M, low=low, high=snap(low + _DOORWAY_M)),),
    )


def _from_corner(piece: FurniturePiece) -> FurniturePlacement:
    return FurniturePlacement(
        x=piece.x - _AROUND_M,
        y=piece.y - _AROUND_M,
        turn=piece.turn,
        width=piece.width,
        depth=piece.depth,
    )


def _is_turned(plan: FloorPlan, number: int) -> bool:
    """Whether a room is a copy rotated by 180 degrees; these rooms lie below their corridor."""
    room = plan.rooms[number]
    above = (door.wall == room.y1 for door in plan.doorways if number in door.rooms)
    return room.kind is not RoomKind.HALL and any(above)


def _sides(plan: FloorPlan, number: int) -> tuple[WallSide, ...]:
    """Return the walls of a room in the order of an unturned room; the door is in the third wall."""
    low_x, high_x, low_y, high_y = wall_sides(plan, number)
    if _is_turned(plan, number):
        return high_x, low_x, high_y, low_y
    return low_x, high_x, low_y, high_y


def _placed(placement: FurniturePlacement, room: Room, *, turned: bool) -> FurniturePlacement:
    """Return the placement of a piece in a room."""
    if not turned:
        return replace(placement, x=room.x0 + placement.x, y=room.y0 + placement.y)
    cos, sin = placement.turn
    return replace(placement, x=room.x1 - placement.x, y=room.y1 - placement.y, turn=(0.0 - cos, 0.0 - sin))


def _hang_picture(shell: RoomShell, side: WallSide, pictures: tuple[TextureIndex, TextureIndex]) -> None:
    """Add a window to the wall opposite the door, or a picture of the same size if another room is behind the wall."""
    view, picture = pictures
    low = (side.low + side.high - _PICTURE_M) / 2
    shell.mount(side, (low, low + _PICTURE_M), 0.9, 2.1, view if side.outer else picture)


def _hang_posters(
    posters: RoomShell, rng: SeededRng, pattern: Pattern, room: Room, sides: tuple[WallSide, ...]
) -> None:
    """Hang a poster in some rooms, and a few in corridors, where no furniture hides the wall."""
    if room.kind is RoomKind.HALL:
        for side in sides:
            for _ in range(_POSTERS_IN_CORRIDOR):
                posters.hang_painting(side, [])
    elif rng.chance(_POSTER_SHARE):
        number = rng.index(2)
        turned = sides[0].inward < 0
        covered = [
            (room.y1 - high, room.y1 - low) if turned else (room.y0 + low, room.y0 + high)
            for low, high in pattern.hidden[number]
        ]
        posters.hang_painting(sides[number], covered)
