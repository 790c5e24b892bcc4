"""Generates a shop from a seed: one or two halls with rows of tall shelves, and tills at the entrance.

The same seed gives the same shop on every machine, as with apartments: the order of the draws is part of the format.
Every shelf shows many small coloured goods, but all aisles have the same shape. Coordinates are as in `floor_plan`; the
parts of a hall count as rooms.

    +-----------------------+
    |      cross aisle      |
    | || |  || |  || |  ||  |
    | || |  || |  || |  ||  |   aisles between shelves
    |      cross aisle      |   (only in a deep hall)
    | || |  || |  || |  ||  |
    | || |  || |  || |  ||  |
    |         tills         |
    +-----------------------+
"""

from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product

import numpy as np

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments import furniture as f
from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, FloorPlan, OccupancyGrid, snap
from ltvn_core.simulation.apartments.furniture import FurnitureBuilder, FurnitureKind, FurniturePlacement
from ltvn_core.simulation.apartments.furniture_placement import FurniturePlacer
from ltvn_core.simulation.apartments.generation import Building, finished_building
from ltvn_core.simulation.apartments.materials import choose_apartment_materials, choose_room_materials
from ltvn_core.simulation.apartments.room_shell import RoomShell, WallSide, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.zones import in_zones
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind, SceneParts
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_LARGEST_HALL_M2 = 400.0
_HEIGHT_M = 3.0
_SHELF_M = 0.9
"""Depth of a shelf with goods on both sides, in metres; shelves along walls have half of it."""
_SECTION_M = 1.25
"""Approximate length of a section of shelves, in metres."""
_LEVEL_M = 0.36
_TILLS_M = 5.0
"""Depth of the floor with the tills, in metres."""
_TILL_PITCH_M = 2.2
_TWO_BLOCKS_M = 12.0
"""Length of shelves in metres above which a cross aisle divides them."""
_DOORWAY_M = 1.2
_GOODS = 24
"""Number of pictures of goods in a shop; each is on several shelves."""


@dataclass(frozen=True, slots=True)
class ShopPlan:
    """The halls of a shop, and where shelves stand in each of them."""

    walls: FloorPlan
    across: tuple[float, ...]
    """Edges of the aisles along x, in metres from the hall's edge: centre lines of shelves, and the walls."""
    along: tuple[tuple[float, float], ...]
    """Start and end of each block of shelves along y, in metres."""

    def zones(self, hall: Room) -> tuple[Room, ...]:
        """Return the parts of a hall: the floor with the tills, aisles and cross aisles."""
        cuts = [hall.y0, *(y for block in self.along for y in block), hall.y1]
        crossing = [Room(RoomKind.HALL, hall.x0, y0, hall.x1, y1) for y0, y1 in zip(cuts[::2], cuts[1::2], strict=True)]
        aisles = [
            Room(RoomKind.AISLE, snap(hall.x0 + x0), y0, snap(hall.x0 + x1), y1)
            for (y0, y1), (x0, x1) in product(self.along, pairwise(self.across))
        ]
        return (*crossing, *aisles)


def generate_shop_plan(rng: SeededRng, area_m2: float) -> ShopPlan:
    """Return the plan of a shop with a given area (200 to 800 m2); above 400 m2 it has two equal halls."""
    halls = 1 if area_m2 <= _LARGEST_HALL_M2 else 2
    aisle = rng.uniform_multiple(1.45, 1.9)
    wanted = (area_m2 / halls * rng.uniform(0.85, 1.2)) ** 0.5
    pitch = aisle + _SHELF_M
    aisles = max(3, round(wanted / pitch))
    width = snap(aisles * pitch)
    depth = snap(area_m2 / halls / width)
    crossing = rng.uniform_multiple(1.7, 2.1)
    end = snap(depth - crossing)
    middle = snap((_TILLS_M + end) / 2 - rng.uniform(0.5, 1.5))
    divided = end - _TILLS_M > _TWO_BLOCKS_M
    return ShopPlan(
        walls=_walls(width, depth, halls, end),
        across=(0.0, *(snap(number * pitch) for number in range(1, aisles)), width),
        along=((_TILLS_M, middle), (snap(middle + crossing), end)) if divided else ((_TILLS_M, end),),
    )


def _walls(width: float, depth: float, halls: int, end: float) -> FloorPlan:
    """Return halls side by side, with doorways between their tills and between their cross aisles at the back."""
    edges = [snap(width * number) for number in range(halls + 1)]
    rooms = tuple(Room(RoomKind.HALL, x0, 0.0, x1, depth) for x0, x1 in pairwise(edges))
    doorways = tuple(
        Doorway(rooms=(0, 1), axis=0, wall=width, low=low, high=snap(low + _DOORWAY_M))
        for low in (0.4, snap(end + 0.3))
        if halls > 1
    )
    return FloorPlan(width=edges[-1], depth=depth, rooms=rooms, doorways=doorways)


def generate_shop(seed: int, area_m2: float) -> Building:
    """Generate the shop of a seed with a floor area (200 to 800 m2)."""
    rng = SeededRng(np.random.default_rng(seed))
    plan = generate_shop_plan(rng.spawn(), area_m2)
    builder = SurfaceBuilder()
    occupancy = OccupancyGrid(plan.walls)
    materials = choose_apartment_materials(builder, rng.spawn())
    shell = RoomShell(builder, occupancy, rng.spawn(), materials, _HEIGHT_M)
    placer = FurniturePlacer(builder, occupancy, materials)
    goods = [builder.texture(decals.goods(rng)) for _ in range(_GOODS)]
    hue = rng.uniform(0, 1)
    for number, hall in enumerate(plan.walls.rooms):
        sides = wall_sides(plan.walls, number)
        # A kitchen's floor: tiles and stone.
        shell.draw(hall, sides, choose_room_materials(builder, rng.spawn(), RoomKind.KITCHEN, hue + 0.4 * number))
        _shelves(placer, rng.spawn(), plan, hall, sides, goods)
        _front(placer, rng.spawn(), hall, f.LOW_TABLE if number else _TILL)
        for side in sides[2:]:
            shell.decorate_long(hall, side)
    zoned = in_zones(plan.walls, [plan.zones(hall) for hall in plan.walls.rooms])
    parts = SceneParts(
        doorways=zoned.doorways, furniture=tuple(placer.placed), paintings=tuple(shell.paintings), rugs=()
    )
    return finished_building(zoned, builder, occupancy, parts)


def _shelves(
    placer: FurniturePlacer,
    rng: SeededRng,
    plan: ShopPlan,
    hall: Room,
    sides: tuple[WallSide, ...],
    goods: list[TextureIndex],
) -> None:
    """Place the shelves of a hall, section by section; all shelves of a row have the same height."""
    rows = [(snap(hall.x0 + x), _SHELF_M) for x in plan.across[1:-1]]
    rows += [(side.face + side.inward * _SHELF_M / 4, _SHELF_M / 2) for side in sides[:2]]
    for (x, depth), (low, high) in product(rows, plan.along):
        sections = round((high - low) / _SECTION_M)
        length = int((high - low) / sections / GRID_STEP_M + 1e-6) * GRID_STEP_M
        draw = partial(_draw_shelf, goods=goods, height_m=rng.uniform(1.8, 2.2))
        kind = FurnitureKind(name="goods-shelf", width=(length, length), depth=(depth, depth), draw=draw, tall=True)
        for number in range(sections):
            y = low + (number + 0.5) * length
            placer.place_at(rng, kind, FurniturePlacement(x=x, y=y, turn=(0.0, 1.0), width=length, depth=depth))


def _front(placer: FurniturePlacer, rng: SeededRng, hall: Room, kind: FurnitureKind) -> None:
    """Place a row of tills, or of tables with special offers, between the entrance and the shelves."""
    along, depth = kind.usual_size
    count = min(2 + rng.index(3), int((hall.x1 - hall.x0 - 3.0) / _TILL_PITCH_M))
    for number in range(count):
        x = snap(hall.x0 + 2.0 + number * _TILL_PITCH_M)
        placement = FurniturePlacement(x=x, y=_TILLS_M / 2 + 0.1, turn=(0.0, 1.0), width=along, depth=depth)
        placer.place_at(rng, kind, placement)


def _draw_shelf(c: FurnitureBuilder, *, goods: list[TextureIndex], height_m: float) -> None:
    """Build boards with goods that are visible from both sides."""
    w = c.placement.width
    d = c.placement.depth
    inner = w - 0.06
    c.box(c.materials.dark, (0, 0, 0), (inner, d, 0.1))
    levels = int((height_m - 0.1) / _LEVEL_M)
    for level in range(levels):
        z = 0.1 + level * _LEVEL_M
        c.box(c.materials.white, (0, 0, z), (inner, d, 0.04))
        c.box(c.rng.choice(goods), (0, 0, z + 0.04), (inner, d - 0.08, 0.29), tile_m=None)
    c.box(c.materials.white, (0, 0, 0.1 + levels * _LEVEL_M), (inner, d, height_m - 0.1 - levels * _LEVEL_M))
    for side in (-1, 1):
        c.box(c.materials.metal, (side * (w / 2 - 0.015), 0, 0), (0.03, d + 0.004, height_m))


def _draw_till(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.rng.choice(c.materials.paints), (0, 0, 0), (w, d, 0.84))
    c.box(c.materials.dark, (-0.15 * w, 0, 0.84), (0.7 * w, d - 0.1, 0.03))
    c.box(c.materials.metal, (0.4 * w, 0, 0.84), (0.1, 0.1, 0.3))
    c.image_box(decals.painting(c.rng), (0.4 * w, 0, 1.14), (0.06, 0.36, 0.26))


_TILL = FurnitureKind(name="till", width=(1.8, 1.8), depth=(0.6, 0.6), draw=_draw_till)
