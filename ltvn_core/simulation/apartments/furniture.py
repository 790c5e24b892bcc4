"""The kinds of furniture and the geometry of each.

Each piece is built in its own frame: x along its width, y from its back to its front, the origin on the floor in its
centre. Its geometry fills its rectangle on the floor, because the planner takes the whole rectangle as blocked.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments.floor_plan import snap
from ltvn_core.simulation.apartments.materials import ApartmentMaterials
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex
from ltvn_core.types import Rgb


@dataclass(frozen=True, slots=True)
class FurniturePlacement:
    """Position, rotation and size of one piece on the floor, in metres."""

    x: float
    y: float
    turn: tuple[float, float]
    """(cos, sin) of the rotation from the frame of the piece to that of the apartment."""
    width: float
    depth: float


@dataclass(frozen=True, slots=True)
class FurnitureBuilder:
    """Adds boxes and cylinders in the frame of one piece, with the materials of its room."""

    builder: SurfaceBuilder
    placement: FurniturePlacement
    rng: SeededRng
    materials: ApartmentMaterials
    wood: TextureIndex
    cloth: TextureIndex

    def box(
        self,
        texture: TextureIndex,
        at: tuple[float, float, float],
        size: tuple[float, float, float],
        *,
        tile_m: float | None = 1.0,
    ) -> None:
        """Add a box with its bottom centre at `at`."""
        x, y = self._placed(at)
        centre = (x, y, at[2] + size[2] / 2)
        self.builder.box(texture, centre, size, turn=self.placement.turn, tile_m=tile_m)

    def cylinder(
        self,
        texture: TextureIndex,
        at: tuple[float, float, float],
        radius: float,
        height: float,
        top: float | None = None,
    ) -> None:
        """Add a cylinder with its bottom centre at `at`."""
        self.builder.cylinder(texture, (*self._placed(at), at[2]), radius, height, top_radius=top)

    def image_box(self, image: Rgb, at: tuple[float, float, float], size: tuple[float, float, float]) -> None:
        """Add a box whose sides each show an image once."""
        self.box(self.builder.texture(image), at, size, tile_m=None)

    def _placed(self, at: tuple[float, float, float]) -> tuple[float, float]:
        cos, sin = self.placement.turn
        return self.placement.x + cos * at[0] - sin * at[1], self.placement.y + sin * at[0] + cos * at[1]


DrawFurniture = Callable[[FurnitureBuilder], None]


@dataclass(frozen=True, slots=True)
class FurnitureKind:
    """A kind of furniture: its name, the ranges of its size in metres, and the function that builds it."""

    name: str
    width: tuple[float, float]
    depth: tuple[float, float]
    draw: DrawFurniture
    against_wall: bool = True
    tall: bool = False
    """Whether the piece hides the wall behind it; nothing is hung on that part of the wall."""

    @property
    def usual_size(self) -> tuple[float, float]:
        """Width and depth in the middle of their ranges; half of each is a multiple of the floor's grid."""
        return 2 * snap(sum(self.width) / 4), 2 * snap(sum(self.depth) / 4)


def _sofa(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.cloth, (0, 0, 0), (w, d, 0.42), tile_m=0.6)
    c.box(c.cloth, (0, -d / 2 + 0.11, 0.42), (w, 0.22, 0.4), tile_m=0.6)
    for side in (-1, 1):
        c.box(c.cloth, (side * (w / 2 - 0.1), 0, 0.42), (0.2, d, 0.18), tile_m=0.6)
    for place in (-0.3, 0.0, 0.3):
        c.box(c.rng.choice(c.materials.cloths), (place * w, -d / 2 + 0.3, 0.42), (0.36, 0.14, 0.3), tile_m=0.4)


def _armchair(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.cloth, (0, 0, 0), (w, d, 0.4), tile_m=0.5)
    c.box(c.cloth, (0, -d / 2 + 0.1, 0.4), (w, 0.2, 0.45), tile_m=0.5)


def _solid_table(c: FurnitureBuilder, height: float) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.wood, (0, 0, height - 0.05), (w, d, 0.05))
    c.box(c.rng.choice(c.materials.paints), (0, 0, 0), (w - 0.08, d - 0.08, height - 0.05))
    for _ in range(c.rng.index(4)):
        at = (c.rng.uniform(-0.35, 0.35) * w, c.rng.uniform(-0.35, 0.35) * d, height)
        c.box(c.rng.choice(c.materials.paints), at, (0.18, 0.12, c.rng.uniform(0.05, 0.25)))


def _low_table(c: FurnitureBuilder) -> None:
    _solid_table(c, 0.42)


def _high_table(c: FurnitureBuilder) -> None:
    _solid_table(c, 0.76)
    c.cylinder(c.rng.choice(c.materials.paints), (0, 0, 0.76), 0.09, 0.22, 0.14)


def _shelf(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    height = c.rng.uniform(1.3, 2.1)
    c.box(c.wood, (0, -d / 2 + 0.02, 0), (w, 0.04, height))
    for side in (-1, 1):
        c.box(c.wood, (side * (w / 2 - 0.02), 0, 0), (0.04, d, height))
    levels = int(height / 0.36)
    for level in range(levels + 1):
        z = level * (height - 0.03) / levels
        c.box(c.wood, (0, 0, z), (w, d, 0.03))
        if level < levels:
            c.box(c.rng.choice(c.materials.books), (0, -0.03, z + 0.03), (w - 0.08, d - 0.12, 0.26), tile_m=None)


def _wardrobe(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    height = c.rng.uniform(1.9, 2.2)
    c.box(c.wood, (0, 0, 0), (w, d, height), tile_m=0.9)
    c.box(c.materials.dark, (0, d / 2, 0.1), (0.012, 0.006, height - 0.2))
    for side in (-1, 1):
        c.box(c.materials.metal, (side * 0.07, d / 2 + 0.01, height / 2), (0.025, 0.025, 0.3))


def _chest(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.rng.choice((c.wood, *c.materials.paints)), (0, 0, 0), (w, d, 0.9))
    for level in range(3):
        c.box(c.materials.dark, (0, d / 2, 0.28 * level + 0.3), (w - 0.1, 0.006, 0.012))
        c.box(c.materials.metal, (0, d / 2 + 0.01, 0.28 * level + 0.16), (0.18, 0.02, 0.025))
    c.cylinder(c.rng.choice(c.materials.cloths), (0.25 * w, 0, 0.9), 0.11, 0.3, 0.06)
    c.image_box(decals.painting(c.rng), (-0.2 * w, -d / 4, 0.9), (0.3, 0.03, 0.26))


def _bed(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.wood, (0, 0, 0), (w, d, 0.3))
    c.box(c.materials.white, (0, 0, 0.3), (w - 0.06, d - 0.08, 0.18))
    c.box(c.cloth, (0, 0.3, 0.42), (w, d - 0.62, 0.12), tile_m=0.7)
    c.box(c.wood, (0, -d / 2 + 0.03, 0.3), (w, 0.06, 0.75))
    for side in (-1, 1):
        c.box(c.rng.choice(c.materials.cloths), (side * w / 4, -d / 2 + 0.3, 0.48), (w / 2.6, 0.36, 0.13), tile_m=0.4)


def _desk(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    _solid_table(c, 0.74)
    c.box(c.materials.dark, (0, -d / 2 + 0.1, 0.86), (0.56, 0.04, 0.34))
    c.image_box(decals.painting(c.rng), (0, -d / 2 + 0.13, 0.88), (0.52, 0.01, 0.3))
    c.box(c.materials.dark, (0, -d / 2 + 0.12, 0.74), (0.2, 0.14, 0.12))
    c.box(c.materials.white, (0.25 * w, 0.05, 0.74), (0.22, 0.3, 0.02))


def _chair(c: FurnitureBuilder, x: float, y: float, towards: int) -> None:
    """Add a chair that faces the side of larger (+1) or smaller (-1) y."""
    c.box(c.cloth, (x, y, 0), (0.42, 0.42, 0.45), tile_m=0.5)
    c.box(c.cloth, (x, y - towards * 0.18, 0.45), (0.42, 0.06, 0.4), tile_m=0.5)


def _table_with_chairs(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.wood, (0, 0, 0.7), (w, d - 0.8, 0.05))
    for side in (-1, 1):
        c.box(c.materials.metal, (side * (w / 2 - 0.2), 0, 0), (0.06, d - 1.0, 0.7))
        for place in (-0.33, 0.0, 0.33):
            _chair(c, place * w, side * (d / 2 - 0.21), -side)
    c.box(c.rng.choice(c.materials.paints), (c.rng.uniform(-0.3, 0.3) * w, 0, 0.75), (0.14, 0.14, 0.18))


def _desk_group(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.cloth, (0, 0, 0), (w, 0.06, 1.3), tile_m=0.8)
    for side, place in product((-1, 1), (-0.25, 0.25)):
        c.box(c.wood, (place * w, side * 0.38, 0.7), (w / 2 - 0.02, 0.7, 0.04))
        c.box(c.materials.white, (place * w + 0.2 * w, side * 0.38, 0), (0.08 * w, 0.6, 0.7))
        c.box(c.materials.dark, (place * w, side * 0.2, 0.8), (0.54, 0.04, 0.34))
        c.image_box(decals.painting(c.rng), (place * w, side * 0.23, 0.82), (0.5, 0.01, 0.3))
        _chair(c, place * w + c.rng.uniform(-0.2, 0.2), side * (d / 2 - 0.21), -side)


def _counter(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    front = c.rng.choice((c.materials.white, *c.materials.paints))
    c.box(front, (0, 0, 0), (w, d - 0.02, 0.88))
    c.box(c.wood, (0, 0, 0.88), (w, d, 0.04))
    c.box(c.materials.metal, (-0.25 * w, 0, 0.92), (0.5, 0.38, 0.012))
    c.box(c.materials.dark, (0.25 * w, 0, 0.92), (0.55, 0.46, 0.012))
    c.box(front, (0, -d / 2 + 0.17, 1.45), (w, 0.34, 0.6))
    for door in range(int(w / 0.5)):
        c.box(c.materials.metal, (-w / 2 + 0.25 + 0.5 * door, d / 2, 0.75), (0.18, 0.02, 0.02))
        c.box(c.materials.dark, (-w / 2 + 0.5 * door, d / 2 - 0.008, 0.1), (0.01, 0.006, 0.74))


def _fridge(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.rng.choice((c.materials.white, c.materials.metal, *c.materials.paints)), (0, 0, 0), (w, d, 1.8))
    c.box(c.materials.dark, (0, d / 2, 1.15), (w, 0.006, 0.015))
    c.box(c.materials.dark, (0.4 * w, d / 2 + 0.02, 1.25), (0.03, 0.03, 0.3))


def _legs(c: FurnitureBuilder, height: float, side: float) -> None:
    """Add four legs at the corners."""
    for across, down in product((-1, 1), (-1, 1)):
        at = (across * (c.placement.width - side) / 2, down * (c.placement.depth - side) / 2, 0)
        c.box(c.materials.metal, at, (side, side, height))


def _open_table(c: FurnitureBuilder) -> None:
    height = c.rng.uniform(0.69, 0.79)
    _legs(c, height - 0.03, 0.04)
    c.box(c.wood, (0, 0, height - 0.03), (c.placement.width, c.placement.depth, 0.03))


def _open_rack(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    _legs(c, 2.2, 0.06)
    for level in range(3):
        z = c.rng.uniform(0.67, 0.76) + 0.65 * level
        c.box(c.wood, (0, 0, z), (w, d, 0.04))
        for place in (-0.3, 0.0, 0.3):
            size = (0.25 * w, 0.7 * d, c.rng.uniform(0.2, 0.4))
            c.box(c.rng.choice(c.materials.paints), (place * w, 0, z + 0.04), size)


def _bar(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    height = c.rng.uniform(0.7, 0.82)
    c.box(c.rng.choice(c.materials.paints), (0, -d / 2 + 0.1, 0), (w, 0.2, height - 0.04))
    c.box(c.materials.white, (0, 0, height - 0.04), (w, d, 0.04))


def _television(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.wood, (0, 0, 0), (w, d, 0.5))
    c.box(c.materials.dark, (0, -0.05, 0.55), (0.8 * w, 0.05, 0.64))
    c.image_box(decals.painting(c.rng), (0, -0.02, 0.58), (0.76 * w, 0.014, 0.58))


def _plant(c: FurnitureBuilder) -> None:
    c.cylinder(c.rng.choice(c.materials.paints), (0, 0, 0), 0.16, 0.36, 0.21)
    for _ in range(14):
        at = (c.rng.uniform(-0.17, 0.17), c.rng.uniform(-0.17, 0.17), c.rng.uniform(0.36, 1.1))
        c.box(c.materials.green, at, (c.rng.uniform(0.06, 0.18), c.rng.uniform(0.06, 0.18), 0.24))


def _lamp(c: FurnitureBuilder) -> None:
    c.cylinder(c.materials.dark, (0, 0, 0), 0.15, 0.9, 0.03)
    c.cylinder(c.materials.dark, (0, 0, 0.9), 0.02, 0.5)
    c.cylinder(c.rng.choice(c.materials.cloths), (0, 0, 1.35), 0.22, 0.32, 0.13)


def _toy_chest(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.rng.choice(c.materials.paints), (0, 0, 0), (w, d, 0.45))
    for place in (-0.3, 0.0, 0.3):
        c.box(c.rng.choice(c.materials.paints), (place * w, 0, 0.45), (0.16, 0.16, c.rng.uniform(0.1, 0.3)))
    c.image_box(decals.clock(c.rng), (0, -d / 2 + 0.02, 0.6), (0.3, 0.02, 0.3))


def _bathtub(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.materials.white, (0, 0, 0), (w, d, 0.56))
    c.box(c.materials.metal, (0, 0, 0.56), (w - 0.2, d - 0.2, 0.01))
    c.box(c.rng.choice(c.materials.cloths), (w / 2 - 0.03, 0, 0.56), (0.04, d, 1.3), tile_m=0.6)


def _toilet(c: FurnitureBuilder) -> None:
    c.box(c.materials.white, (0, 0.06, 0), (0.4, 0.5, 0.42))
    c.box(c.materials.white, (0, -0.24, 0), (0.42, 0.2, 0.9))


def _basin(c: FurnitureBuilder) -> None:
    w = c.placement.width
    d = c.placement.depth
    c.box(c.wood, (0, 0, 0), (w, d, 0.8))
    c.box(c.materials.white, (0, 0, 0.8), (w, d, 0.07))
    c.box(c.materials.metal, (0, -d / 2 + 0.02, 1.1), (w * 0.9, 0.02, 0.7))


SOFA = FurnitureKind(name="sofa", width=(1.6, 2.3), depth=(0.85, 0.95), draw=_sofa)
ARMCHAIR = FurnitureKind(name="armchair", width=(0.75, 0.9), depth=(0.75, 0.85), draw=_armchair, against_wall=False)
LOW_TABLE = FurnitureKind(name="low-table", width=(0.8, 1.2), depth=(0.55, 0.7), draw=_low_table, against_wall=False)
HIGH_TABLE = FurnitureKind(name="high-table", width=(1.2, 1.7), depth=(0.8, 0.9), draw=_high_table, against_wall=False)
SHELF = FurnitureKind(name="shelf", width=(0.8, 1.5), depth=(0.35, 0.4), draw=_shelf, tall=True)
WARDROBE = FurnitureKind(name="wardrobe", width=(1.0, 1.9), depth=(0.6, 0.6), draw=_wardrobe, tall=True)
CHEST = FurnitureKind(name="chest", width=(0.8, 1.3), depth=(0.45, 0.5), draw=_chest)
BED = FurnitureKind(name="bed", width=(1.1, 1.7), depth=(2.0, 2.1), draw=_bed)
DESK = FurnitureKind(name="desk", width=(1.2, 1.6), depth=(0.65, 0.75), draw=_desk)
COUNTER = FurnitureKind(name="counter", width=(1.6, 2.8), depth=(0.6, 0.6), draw=_counter, tall=True)
FRIDGE = FurnitureKind(name="fridge", width=(0.65, 0.7), depth=(0.65, 0.7), draw=_fridge, tall=True)
TELEVISION = FurnitureKind(name="television", width=(1.2, 1.8), depth=(0.45, 0.45), draw=_television, tall=True)
TABLE_WITH_CHAIRS = FurnitureKind(
    name="table-with-chairs", width=(2.0, 2.0), depth=(1.6, 1.6), draw=_table_with_chairs, against_wall=False
)
DESK_GROUP = FurnitureKind(name="desk-group", width=(3.2, 3.2), depth=(2.3, 2.3), draw=_desk_group, against_wall=False)
OPEN_TABLE = FurnitureKind(name="open-table", width=(1.8, 1.8), depth=(0.9, 0.9), draw=_open_table, against_wall=False)
OPEN_RACK = FurnitureKind(name="open-rack", width=(3.0, 3.0), depth=(1.0, 1.0), draw=_open_rack, against_wall=False)
BAR = FurnitureKind(name="bar", width=(2.4, 2.4), depth=(0.8, 0.8), draw=_bar, against_wall=False)
PLANT = FurnitureKind(name="plant", width=(0.45, 0.45), depth=(0.45, 0.45), draw=_plant)
LAMP = FurnitureKind(name="lamp", width=(0.4, 0.4), depth=(0.4, 0.4), draw=_lamp)
TOY_CHEST = FurnitureKind(name="toy-chest", width=(0.8, 1.2), depth=(0.4, 0.45), draw=_toy_chest)
BATHTUB = FurnitureKind(name="bathtub", width=(1.5, 1.7), depth=(0.75, 0.8), draw=_bathtub)
TOILET = FurnitureKind(name="toilet", width=(0.45, 0.45), depth=(0.7, 0.7), draw=_toilet)
BASIN = FurnitureKind(name="basin", width=(0.6, 0.9), depth=(0.45, 0.5), draw=_basin, tall=True)
