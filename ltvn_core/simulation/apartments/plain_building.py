"""Generates a plain building from a seed: bare grey walls and floors, no pictures, no windows, hardly any furniture.

Places differ mainly in the shape of their rooms. The same seed gives the same building on every machine, as with
apartments: the order of the draws is part of the format.
"""

import numpy as np

from ltvn_core.simulation.apartments import tiling_textures
from ltvn_core.simulation.apartments.floor_plan import FloorPlan, OccupancyGrid, generate_floor_plan
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import RoomMaterials, choose_apartment_materials
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import hsv_colour
from ltvn_core.simulation.rooms import RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder

_FURNISHED = {RoomKind.KITCHEN, RoomKind.BATH}
"""Kinds of rooms with furniture; all others are empty."""


def generate_plain_building(seed: int, area_m2: float) -> Building:
    """Generate the plain building of a seed with a floor area (150 to 250 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    while True:  # As with apartments, a plan whose empty rooms are not connected is drawn again.
        plan = generate_floor_plan(rng.spawn(), area_m2)
        builder = SurfaceBuilder()
        occupancy = OccupancyGrid(plan)
        placer = _walls(plan, builder, occupancy, rng)
        if occupancy.is_connected():
            break
    for index, room in enumerate(plan.rooms):
        if room.kind in _FURNISHED:
            placer.place_furniture(rng.spawn(), room, wall_sides(plan, index))
    parts = SceneParts(doorways=plan.doorways, furniture=tuple(placer.placed), paintings=(), rugs=())
    return finished_building(plan, builder, occupancy, parts)


def _walls(plan: FloorPlan, builder: SurfaceBuilder, occupancy: OccupancyGrid, rng: SeededRng) -> FurniturePlacer:
    """Build identical floors, ceilings and walls, and return the placer of furniture."""
    materials = choose_apartment_materials(builder, rng.spawn())
    grey = builder.texture(tiling_textures.plain(rng.spawn(), hsv_colour(0.6, 0.02, rng.uniform(0.6, 0.8))))
    floor = builder.texture(tiling_textures.plain(rng.spawn(), hsv_colour(0.1, 0.04, rng.uniform(0.4, 0.55))))
    style = RoomMaterials(wall=grey, accent=grey, floor=floor, floor_tile_m=2.0)
    shell = RoomShell(builder, occupancy, rng.spawn(), materials, 2.6)
    for index, room in enumerate(plan.rooms):
        shell.draw(room, wall_sides(plan, index), style)
    return FurniturePlacer(builder, occupancy, materials)
