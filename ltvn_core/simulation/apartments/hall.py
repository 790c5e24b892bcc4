"""Generates a hall from a seed: a building with one large open room, such as a canteen, open-plan office or lobby.

The same seed gives the same hall on every machine, as with apartments: the order of the draws is part of the format.
Islands of tables, desks or sofas stand on a wide free floor, and two to four small rooms lie along one side. Most walls
are far away, and each view shows a large part of the hall. Coordinates are as in `floor_plan`; the parts of the hall
count as rooms.

    +-----+-----+------+
    |     |     |      |
    +- ---+- ---+- ----+
    |  ==    ==    ==  |
    |                  |
    |  ==    ==    ==  |
    +------------------+
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from ltvn_core.simulation.apartments import furniture as f
from ltvn_core.simulation.apartments.floor_plan import (
    FloorPlan,
    FloorRectangle,
    OccupancyGrid,
    mirrored,
    snap,
)
from ltvn_core.simulation.apartments.furniture import FurnitureKind, FurniturePlacement
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import choose_apartment_materials, choose_room_materials
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.zones import in_zones
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_HEIGHT_M = 3.2
_DOORWAY_M = 0.95
_ISLAND_PITCH_M = 5.2
"""Least distance between the middles of islands, in metres, so that ways wider than a metre remain between them."""
_ISLAND_SHIFT_M = 0.3
_WALL_GAP_M = 0.6
"""Distance between the walls and the cells in which islands stand, in metres."""
_ZONE_M = 6.0
_PILLAR_M = 0.4
_SMALL_ROOMS = (RoomKind.MEETING, RoomKind.STUDY, RoomKind.KITCHEN, RoomKind.LIBRARY)

Island = tuple[tuple[FurnitureKind, FurniturePlacement], ...]
"""Pieces of furniture, with their placement relative to the centre of the island."""


def _part(kind: FurnitureKind, y: float, *, cos: float = 1.0) -> tuple[FurnitureKind, FurniturePlacement]:
    width, depth = kind.usual_size
    return kind, FurniturePlacement(x=0.0, y=y, turn=(cos, 0.0), width=width, depth=depth)


_TABLES: Island = (_part(f.TABLE_WITH_CHAIRS, -0.85), _part(f.TABLE_WITH_CHAIRS, 0.85))
_DESKS: Island = (_part(f.DESK_GROUP, 0.0),)
_SOFAS: Island = (_part(f.SOFA, -1.15), _part(f.LOW_TABLE, 0.0), _part(f.SOFA, 1.15, cos=-1.0))
_ISLANDS = (_TABLES, _DESKS, _SOFAS)
OPEN_ISLANDS: tuple[Island, ...] = (
    (_part(f.OPEN_TABLE, -1.0), _part(f.OPEN_TABLE, 0.0), _part(f.OPEN_TABLE, 1.0)),
    (_part(f.OPEN_RACK, 0.0),),
    (_part(f.BAR, -0.4), _part(f.BAR, 0.4, cos=-1.0)),
)
"""Islands under which the floor can be seen, but no robot as high as a table fits."""


def generate_hall_plan(rng: SeededRng, area_m2: float) -> FloorPlan:
    """Return the plan of a hall and the small rooms along it, with a given total area (300 to 650 m2).

    The hall is the first room.
    """
    width = snap((area_m2 * rng.uniform(1.0, 1.3)) ** 0.5)
    depth = snap(area_m2 / width)
    wall = snap(depth - rng.uniform(3.4, 4.0))
    count = 2 + rng.index(3)
    edges = [snap(width * number / count) for number in range(count + 1)]
    rooms = [Room(RoomKind.HALL, 0.0, 0.0, width, wall)]
    doorways: list[Doorway] = []
    for kind, (x0, x1) in zip(rng.shuffled(_SMALL_ROOMS), pairwise(edges), strict=False):
        low = rng.uniform_multiple(x0 + 0.5, x1 - 0.5 - _DOORWAY_M)
        doorways.append(Doorway(rooms=(0, len(rooms)), axis=1, wall=wall, low=snap(low), high=snap(low + _DOORWAY_M)))
        rooms.append(Room(kind, x0, wall, x1, depth))
    return mirrored(FloorPlan(width=width, depth=depth, rooms=tuple(rooms), doorways=tuple(doorways)), rng)


def generate_hall(seed: int, area_m2: float, islands: Sequence[Island] = _ISLANDS) -> Building:
    """Generate the hall of a seed with a floor area (300 to 650 m2), with some kinds of islands."""
    rng = SeededRng(np.random.default_rng(seed))
    plan = generate_hall_plan(rng.spawn(), area_m2)
    builder = SurfaceBuilder()
    occupancy = OccupancyGrid(plan)
    materials = choose_apartment_materials(builder, rng.spawn())
    shell = RoomShell(builder, occupancy, rng.spawn(), materials, _HEIGHT_M)
    hue = rng.uniform(0, 1)
    styles = [
        choose_room_materials(builder, rng.spawn(), room.kind, hue + number / len(plan.rooms))
        for number, room in enumerate(plan.rooms)
    ]
    sides = [wall_sides(plan, number) for number in range(len(plan.rooms))]
    for room, room_sides, style in zip(plan.rooms, sides, styles, strict=True):
        shell.draw(room, room_sides, style)
    placer = FurniturePlacer(builder, occupancy, materials)
    _fill_hall(placer, rng.spawn(), plan.rooms[0], islands)
    _pillars(builder, occupancy, rng.spawn(), plan.rooms[0], styles[0].accent)
    for side in sides[0]:
        shell.decorate_long(plan.rooms[0], side)
    for room, room_sides in zip(plan.rooms[1:], sides[1:], strict=True):
        hidden = placer.place_furniture(rng.spawn(), room, room_sides)
        for side, covered in zip(room_sides, hidden, strict=True):
            shell.add_decoration(room, side, covered)
    zoned = in_zones(plan, [_zones(plan.rooms[0]), *((room,) for room in plan.rooms[1:])])
    parts = SceneParts(
        doorways=zoned.doorways, furniture=tuple(placer.placed), paintings=tuple(shell.paintings), rugs=()
    )
    return finished_building(zoned, builder, occupancy, parts)


def _edges(low: float, high: float, pitch_m: float) -> list[float]:
    """Divide an interval into equal parts of at least `pitch_m`, as many as fit, or one; return the edges of the
    parts."""
    parts = max(1, int((high - low) / pitch_m))
    return [snap(low + (high - low) * number / parts) for number in range(parts + 1)]


def _zones(hall: Room) -> tuple[Room, ...]:
    """Return the equal parts of a hall."""
    columns = _edges(hall.x0, hall.x1, _ZONE_M)
    rows = _edges(hall.y0, hall.y1, _ZONE_M)
    return tuple(
        Room(RoomKind.HALL, x0, y0, x1, y1) for (y0, y1), (x0, x1) in product(pairwise(rows), pairwise(columns))
    )


def _island_edges(hall: Room) -> tuple[list[float], list[float]]:
    """Return the edges along x and y of the cells in which islands stand."""
    return (
        _edges(hall.x0 + _WALL_GAP_M, hall.x1 - _WALL_GAP_M, _ISLAND_PITCH_M),
        _edges(hall.y0 + _WALL_GAP_M, hall.y1 - _WALL_GAP_M, _ISLAND_PITCH_M),
    )


def _fill_hall(placer: FurniturePlacer, rng: SeededRng, hall: Room, islands: Sequence[Island]) -> None:
    """Place islands, most of them of one kind; some cells stay empty."""
    usual = rng.choice(islands)
    for (x0, x1), (y0, y1) in product(*map(pairwise, _island_edges(hall))):
        island = usual if rng.chance(0.7) else rng.choice(islands)
        turned = rng.chance(0.5)
        x = snap((x0 + x1) / 2 + rng.uniform(-_ISLAND_SHIFT_M, _ISLAND_SHIFT_M))
        y = snap((y0 + y1) / 2 + rng.uniform(-_ISLAND_SHIFT_M, _ISLAND_SHIFT_M))
        if not rng.chance(0.12):
            _place_island(placer, rng, island, x, y, turned=turned)


def _place_island(placer: FurniturePlacer, rng: SeededRng, island: Island, x: float, y: float, *, turned: bool) -> None:
    for kind, part in island:
        placement = replace(
            part,
            x=x - part.y if turned else x + part.x,
            y=y + part.x if turned else y + part.y,
            turn=(-part.turn[1], part.turn[0]) if turned else part.turn,
        )
        placer.place_at(rng, kind, placement)


def _pillars(
    builder: SurfaceBuilder, occupancy: OccupancyGrid, rng: SeededRng, hall: Room, texture: TextureIndex
) -> None:
    """Build a few pillars between the cells of the islands."""
    columns, rows = _island_edges(hall)
    crossings = rng.shuffled(tuple(product(columns[1:-1], rows[1:-1])))
    half = _PILLAR_M / 2
    for x, y in crossings[: max(2, len(crossings) // 2)]:
        builder.box(texture, (x, y, _HEIGHT_M / 2), (_PILLAR_M, _PILLAR_M, _HEIGHT_M), tile_m=_HEIGHT_M)
        occupancy.block(FloorRectangle(x0=x - half, y0=y - half, x1=x + half, y1=y + half))
