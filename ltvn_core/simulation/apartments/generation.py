"""Generates an apartment from a seed: floor plan, walls, furniture and decoration.

The same seed gives the same apartment on every machine. The order of the random draws, here and in the modules that
this one calls, is therefore part of the format: a change of it needs a new GENERATOR_VERSION in `scene_registry`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, FloorPlan, OccupancyGrid, generate_floor_plan
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.materials import choose_apartment_materials, choose_room_materials
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, Mask, connected_components
from ltvn_core.simulation.rooms import Room, RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder, Surfaces, TextureIndex
from ltvn_core.simulation.triangle_rasterization import RasterGrid, Triangles, clip_to_heights

_ROOMS_WITH_RUG = {
    RoomKind.LIVING,
    RoomKind.BEDROOM,
    RoomKind.STUDY,
    RoomKind.LIBRARY,
    RoomKind.NURSERY,
    RoomKind.DINING,
}

_RUG_M = 0.03
"""Height in metres below which the robot drives over everything."""
_FINE = 5
"""Subdivisions of a cell's side when its free share is measured."""
_MIN_FREE_SHARE = 0.5
"""A cell is free if more than this share of it is."""


@dataclass(frozen=True, eq=False)
class Building:
    """A furnished apartment or office."""

    plan: FloorPlan
    surfaces: Surfaces
    blocked: NDArray[np.bool_]
    """(rows, columns) cells of 5 cm with an obstacle."""
    origin: NDArray[np.float64]
    """(2,) x and y in metres of the lower corner of that grid."""
    parts: SceneParts
    """Parts that can be moved or exchanged."""


def generate_apartment(seed: int, area_m2: float) -> Building:
    """Generate the apartment of a seed with a floor area (45 to 130 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    while True:  # A plan whose empty rooms are not connected is drawn again; this has not happened so far.
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
    rugs: list[TextureIndex] = []
    for room, room_sides in zip(plan.rooms, sides, strict=True):
        room_rng = rng.spawn()
        if room.kind in _ROOMS_WITH_RUG and room_rng.chance(0.85):
            rugs.append(_lay_rug(builder, room_rng, room))
        hidden = furniture_placer.place_furniture(room_rng, room, room_sides)
        for side, covered in zip(room_sides, hidden, strict=True):
            shell.add_decoration(room, side, covered)
    parts = SceneParts(
        doorways=plan.doorways,
        furniture=tuple(furniture_placer.placed),
        paintings=tuple(shell.paintings),
        rugs=tuple(rugs),
    )
    return finished_building(plan, builder, occupancy, parts)


def finished_building(
    plan: FloorPlan, builder: SurfaceBuilder, occupancy: OccupancyGrid, parts: SceneParts
) -> Building:
    """Return the finished building, with the floor cells that its geometry really occupies."""
    surfaces = builder.build()
    blocked = _occupied_cells(occupancy.blocked, occupancy.origin, surfaces.vertices[surfaces.faces])
    return Building(plan=plan, surfaces=surfaces, blocked=blocked, origin=occupancy.origin, parts=parts)


def _hues(rng: SeededRng, count: int) -> list[float]:
    """Return evenly spaced hues for the rooms, in random order, so that rooms are easy to tell apart."""
    first = rng.uniform(0, 1)
    return [first + order / count for order in rng.shuffled(range(count))]


def _lay_rug(builder: SurfaceBuilder, rng: SeededRng, room: Room) -> TextureIndex:
    width = min(room.x1 - room.x0 - 0.8, rng.uniform(1.4, 2.6))
    depth = min(room.y1 - room.y0 - 0.8, rng.uniform(1.2, 2.2))
    x = rng.uniform(room.x0 + 0.3 + width / 2, room.x1 - 0.3 - width / 2)
    y = rng.uniform(room.y0 + 0.3 + depth / 2, room.y1 - 0.3 - depth / 2)
    texture = builder.texture(decals.rug(rng))
    builder.box(texture, (x, y, 0.003), (width, depth, 0.006), tile_m=None)
    return texture


def _occupied_cells(blocked: Mask, origin: NDArray[np.float64], triangles: Triangles) -> Mask:
    """Return those of the `blocked` cells (rows, columns) that the geometry really occupies or encloses.

    Furniture blocks a whole rectangle; a round pot leaves the corners of its square free. Without this correction the
    clearance map would contain obstacles that no camera can see.

    Args:
        blocked: Cells that are blocked by walls and rectangles of furniture.
        origin: (2,) the grid's lower corner in metres.
        triangles: (F, 3, 3) all visible surfaces.
    """
    rows, columns = blocked.shape
    raster = RasterGrid(origin, (rows * _FINE, columns * _FINE), GRID_STEP_M / _FINE)
    open_parts = ~raster.cover(clip_to_heights(triangles, _RUG_M, OBSTACLE_HEIGHT_M))
    # The inside of a shelf is empty too, but cannot be entered from the floor.
    components, _ = connected_components(open_parts)
    floor = open_parts & ~blocked.repeat(_FINE, axis=0).repeat(_FINE, axis=1)
    entered = open_parts & np.isin(components, np.unique(components[floor]))
    free_share = entered.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3))
    return blocked & (free_share <= _MIN_FREE_SHARE)
