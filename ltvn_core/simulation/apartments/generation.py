"""An apartment grown from a seed: plan, shell, furniture and what hangs on the walls.

Owns the order of work. The same seed gives the same apartment on every machine.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments.floor_plan import FloorPlan, Room, RoomKind, generate_floor_plan
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.materials import choose_apartment_materials, choose_room_materials
from ltvn_core.simulation.apartments.occupancy_grid import OccupancyGrid
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.standing import cells_really_blocked
from ltvn_core.simulation.surface_builder import SurfaceBuilder
from ltvn_core.simulation.surfaces import Surfaces

_ROOMS_WITH_RUG = {
    RoomKind.LIVING,
    RoomKind.BEDROOM,
    RoomKind.STUDY,
    RoomKind.LIBRARY,
    RoomKind.NURSERY,
    RoomKind.DINING,
}


@dataclass(frozen=True, eq=False)
class Apartment:
    """A furnished apartment."""

    plan: FloorPlan
    surfaces: Surfaces
    blocked: NDArray[np.bool_]
    """(rows, columns) cells of 5 cm in which something stands."""
    origin: NDArray[np.float64]
    """(2,) x and y of that grid's lower corner."""


def generate_apartment(seed: int, area_m2: float) -> Apartment:
    """Grow an apartment of a floor area (45 to 130 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    while True:  # A plan whose empty rooms are cut off from each other is drawn again; none was met so far.
        plan = generate_floor_plan(rng.spawn(), area_m2)
        builder = SurfaceBuilder()
        occupancy = OccupancyGrid(plan)
        materials = choose_apartment_materials(builder, rng.spawn())
        shell = RoomShell(builder, occupancy, rng.spawn(), materials, round(rng.uniform(2.45, 2.75), 2))
        hues = _hues(rng.spawn(), len(plan.rooms))
        styles = [
            choose_room_materials(builder, rng.spawn(), room.kind, hue)
            for room, hue in zip(plan.rooms, hues, strict=True)
        ]
        sides = [wall_sides(plan, index) for index in range(len(plan.rooms))]
        for room, room_sides, style in zip(plan.rooms, sides, styles, strict=True):
            shell.draw(room, room_sides, style)
        if occupancy.is_connected():
            break
    furniture_placer = FurniturePlacer(builder, occupancy, materials)
    for room, room_sides in zip(plan.rooms, sides, strict=True):
        own = rng.spawn()
        if room.kind in _ROOMS_WITH_RUG and own.chance(0.85):
            _lay_rug(builder, own, room)
        hidden = furniture_placer.place_furniture(own, room, room_sides)
        for side, covered in zip(room_sides, hidden, strict=True):
            shell.add_decoration(room, side, covered)
    surfaces = builder.build()
    blocked = cells_really_blocked(occupancy.blocked, occupancy.origin, surfaces.vertices[surfaces.faces])
    return Apartment(plan=plan, surfaces=surfaces, blocked=blocked, origin=occupancy.origin)


def _hues(rng: SeededRng, count: int) -> list[float]:
    """Spread hues over the rooms, so that no two of them look alike at a glance."""
    first = rng.uniform(0, 1)
    return [first + order / count for order in rng.shuffled(range(count))]


def _lay_rug(builder: SurfaceBuilder, rng: SeededRng, room: Room) -> None:
    width = min(room.x1 - room.x0 - 0.8, rng.uniform(1.4, 2.6))
    depth = min(room.y1 - room.y0 - 0.8, rng.uniform(1.2, 2.2))
    x = rng.uniform(room.x0 + 0.3 + width / 2, room.x1 - 0.3 - width / 2)
    y = rng.uniform(room.y0 + 0.3 + depth / 2, room.y1 - 0.3 - depth / 2)
    builder.box(builder.texture(decals.rug(rng)), (x, y, 0.003), (width, depth, 0.006), tile_m=None)
