"""Generates an office from a seed: equal rooms along corridors, furnished in a few ways that repeat.

The same seed gives the same office on every machine, as with apartments: the order of the draws is part of the format.
"""

from collections.abc import Sequence

import numpy as np

from ltvn_core.simulation.apartments.floor_plan import FloorPlan
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import (
    ApartmentMaterials,
    choose_apartment_materials,
    choose_room_materials,
)
from ltvn_core.simulation.apartments.occupancy_grid import OccupancyGrid
from ltvn_core.simulation.apartments.office_plan import generate_office_plan
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import RoomKind
from ltvn_core.simulation.scene_parts import SceneParts
from ltvn_core.simulation.surface_builder import SurfaceBuilder

FURNISHINGS = 4
"""Ways in which rooms are furnished; each is used about as often."""
_HALLS = FURNISHINGS
"""Number of the draws for corridors, after those for rooms."""


def generate_office(seed: int, area_m2: float) -> Building:
    """Generate the office of a seed with a floor area (400 to 600 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    plan = generate_office_plan(rng.spawn(), area_m2)
    builder, occupancy = SurfaceBuilder(), OccupancyGrid(plan)
    materials = choose_apartment_materials(builder, rng.spawn())
    height_m, hue = round(rng.uniform(2.5, 2.75), 2), rng.uniform(0, 1)
    styles = {
        kind: choose_room_materials(builder, rng.spawn(), kind, hue + shift)
        for kind, shift in ((RoomKind.HALL, 0.0), (RoomKind.STUDY, 0.4))
    }
    seeds = [rng.index(2**32) for _ in range(FURNISHINGS + 1)]
    furnishing = _furnishings(plan, rng.spawn())
    sides = [wall_sides(plan, index) for index in range(len(plan.rooms))]
    shells: list[RoomShell] = []
    for room, room_sides, number in zip(plan.rooms, sides, furnishing, strict=True):
        # The same draws again for each room that is furnished alike.
        draws = SeededRng(np.random.default_rng(seeds[number]))
        shells.append(RoomShell(builder, occupancy, draws, materials, height_m))
        shells[-1].draw(room, room_sides, styles[room.kind])
    return _furnished(plan, builder, occupancy, materials, shells, [seeds[number] for number in furnishing])


def _furnishings(plan: FloorPlan, rng: SeededRng) -> list[int]:
    """Return for each room how it is furnished."""
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
