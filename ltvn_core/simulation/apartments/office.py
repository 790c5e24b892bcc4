"""Generates an office from a seed: equal rooms along corridors, furnished in a few ways that repeat.

The same seed gives the same office on every machine, as with apartments: the order of the draws is part of the format.
Twenty rooms of one size, with equal doors, lie along two corridors that are joined at both ends by two others. The
office is hard to map on purpose: only the way to a room distinguishes it from others. Coordinates are as in
`floor_plan`.

    +--+----+----+----+----+----+--+
    |  |    |    |    |    |    |  |
    |  +- --+- --+- --+- --+- --+  |
    |                              |
    |  +- --+- --+- --+- --+- --+  |
    |  |    |    |    |    |    |  |
    |  +----+----+----+----+----+  |
    |  |    |    |    |    |    |  |
    |  +- --+- --+- --+- --+- --+  |
    |                              |
    |  +- --+- --+- --+- --+- --+  |
    |  |    |    |    |    |    |  |
    +--+----+----+----+----+----+--+
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ltvn_core.simulation.apartments.floor_plan import (
    GRID_STEP_M,
    FloorPlan,
    OccupancyGrid,
    mirrored,
    snap,
)
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import (
    ApartmentMaterials,
    choose_apartment_materials,
    choose_room_materials,
)
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder

ROOMS_IN_ROW = 5
ROWS = 4
_CORRIDORS = 2
_DOORWAY_M = 0.95
_OPENING_INSET_M = 0.15
"""Length of wall on each side of the opening between two corridors, in metres."""
FURNISHINGS = 4
"""Number of furnishings, each used for about the same number of rooms."""
_HALLS = FURNISHINGS
"""Index of the seed for corridors, after the seeds for rooms."""


def generate_office_plan(rng: SeededRng, area_m2: float) -> FloorPlan:
    """Return the floor plan of an office with a given area (400 to 600 m2); its corridors come first."""
    corridor = rng.uniform_multiple(1.6, 1.9)
    deep = rng.uniform_multiple(3.6, 4.0)
    depth = snap(ROWS * deep + _CORRIDORS * corridor)
    wide = snap((area_m2 / depth - 2 * corridor) / ROOMS_IN_ROW)
    width = snap(ROOMS_IN_ROW * wide + 2 * corridor)
    door_at = rng.uniform_multiple(0.5, wide - 0.5 - _DOORWAY_M, GRID_STEP_M)
    lows = [0.0, snap(deep + corridor), snap(2 * deep + corridor), snap(3 * deep + 2 * corridor)]
    halls = corridors(width, depth, corridor, (lows[0] + deep, lows[2] + deep))
    offices: list[Room] = []
    doorways = [opening(halls, along, across) for along, across in product((0, 1), (2, 3))]
    for row, number in product(range(ROWS), range(ROOMS_IN_ROW)):
        x = snap(corridor + number * wide)
        y = lows[row]
        room = Room(kind=RoomKind.STUDY, x0=x, y0=y, x1=snap(x + wide), y1=snap(y + deep))
        wall = room.y1 if row % 2 == 0 else room.y0
        low = snap(x + door_at)
        ends = len(halls) + len(offices), row // 2
        doorways.append(Doorway(rooms=ends, axis=1, wall=wall, low=low, high=snap(low + _DOORWAY_M)))
        offices.append(room)
    plan = FloorPlan(width=width, depth=depth, rooms=(*halls, *offices), doorways=tuple(doorways))
    return mirrored(plan, rng)


def corridors(width: float, depth: float, broad: float, lows: tuple[float, float]) -> tuple[Room, ...]:
    """Return two corridors along x whose lower edges are at y = `lows`, and the two corridors that join their ends."""
    along = [(broad, snap(low), snap(width - broad), snap(low + broad)) for low in lows]
    across = [(0.0, 0.0, broad, depth), (snap(width - broad), 0.0, width, depth)]
    return tuple(Room(RoomKind.HALL, *edges) for edges in (*along, *across))


def opening(halls: tuple[Room, ...], along: int, across: int) -> Doorway:
    """Return the opening between a corridor along x and one that crosses its end."""
    corridor = halls[along]
    other = halls[across]
    return Doorway(
        rooms=(along, across),
        axis=0,
        wall=corridor.x0 if other.x0 < corridor.x0 else corridor.x1,
        low=snap(corridor.y0 + _OPENING_INSET_M),
        high=snap(corridor.y1 - _OPENING_INSET_M),
    )


def generate_office(seed: int, area_m2: float) -> Building:
    """Generate the office of a seed with a floor area (400 to 600 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    plan = generate_office_plan(rng.spawn(), area_m2)
    builder = SurfaceBuilder()
    occupancy = OccupancyGrid(plan)
    materials = choose_apartment_materials(builder, rng.spawn())
    height_m = round(rng.uniform(2.5, 2.75), 2)
    hue = rng.uniform(0, 1)
    styles = {
        kind: choose_room_materials(builder, rng.spawn(), kind, hue + shift)
        for kind, shift in ((RoomKind.HALL, 0.0), (RoomKind.STUDY, 0.4))
    }
    seeds = [rng.index(2**32) for _ in range(FURNISHINGS + 1)]
    furnishing = _furnishings(plan, rng.spawn())
    sides = [wall_sides(plan, index) for index in range(len(plan.rooms))]
    shells: list[RoomShell] = []
    for room, room_sides, number in zip(plan.rooms, sides, furnishing, strict=True):
        # Rooms with the same furnishing repeat the same draws.
        draws = SeededRng(np.random.default_rng(seeds[number]))
        shells.append(RoomShell(builder, occupancy, draws, materials, height_m))
        shells[-1].draw(room, room_sides, styles[room.kind])
    return _furnished(plan, builder, occupancy, materials, shells, [seeds[number] for number in furnishing])


def _furnishings(plan: FloorPlan, rng: SeededRng) -> list[int]:
    """Return the index of each room's furnishing."""
    offices = [index for index, room in enumerate(plan.rooms) if room.kind is not RoomKind.HALL]
    numbers = [_HALLS] * len(plan.rooms)
    for order, index in enumerate(rng.shuffled(offices)):
        numbers[index] = order % FURNISHINGS
    return numbers


def _furnished(
    plan: FloorPlan,
    builder: SurfaceBuilder,
    occupancy: OccupancyGrid,
    materials: ApartmentMaterials,
    shells: Sequence[RoomShell],
    seeds: Sequence[int],
) -> Building:
    """Furnish the rooms and hang pictures where nothing hides the wall; corridors stay free."""
    placer = FurniturePlacer(builder, occupancy, materials)
    for index, (room, shell, seed) in enumerate(zip(plan.rooms, shells, seeds, strict=True)):
        sides = wall_sides(plan, index)
        hidden: list[list[tuple[float, float]]] = [[] for _ in sides]
        if room.kind is not RoomKind.HALL:
            hidden = placer.place_furniture(SeededRng(np.random.default_rng(seed)), room, sides)
        for side, covered in zip(sides, hidden, strict=True):
            shell.add_decoration(room, side, covered)
    parts = SceneParts(
        doorways=plan.doorways,
        furniture=tuple(placer.placed),
        paintings=tuple(texture for shell in shells for texture in shell.paintings),
        rugs=(),
    )
    return finished_building(plan, builder, occupancy, parts)
