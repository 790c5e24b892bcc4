"""The fixed parts of a room: floor, ceiling, walls with doorways, windows and paintings.

Each of two neighbouring rooms builds its half of an inner wall, so that each has its own wallpaper.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ltvn_core.simulation.apartments import decals
from ltvn_core.simulation.apartments.floor_plan import FloorPlan, FloorRectangle, OccupancyGrid
from ltvn_core.simulation.apartments.materials import ApartmentMaterials, RoomMaterials
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_HALF_WALL_M = 0.05
_DOOR_TOP_M = 2.05
_PIECE_OF_WALL_M = 5.0
"""Approximate length in metres of the segments of a long wall; each is decorated like the wall of a room."""


@dataclass(frozen=True, slots=True)
class WallSide:
    """One wall of a room, seen from inside."""

    axis: int
    """0 for a wall along y, 1 for a wall along x."""
    at: float
    """Coordinate of the wall's centre line on that axis."""
    inward: int
    """+1 if the room lies on the side of larger coordinates, else -1."""
    low: float
    """Coordinate along the wall of its start."""
    high: float
    """Coordinate along the wall of its end."""
    gaps: tuple[tuple[float, float], ...]
    """Doorways (low, high) along the wall, in order."""
    outer: bool
    """Whether the wall bounds the apartment."""

    @property
    def face(self) -> float:
        """Coordinate of the wall's visible surface on its axis."""
        return self.at if self.outer else self.at + self.inward * _HALF_WALL_M

    def solid_segments(self) -> Iterator[tuple[float, float]]:
        """Yield the segments (low, high) between doorways."""
        cursor = self.low
        for low, high in self.gaps:
            yield cursor, low
            cursor = high
        yield cursor, self.high


def wall_sides(plan: FloorPlan, index: int) -> tuple[WallSide, ...]:
    """Return the four walls of a room."""
    room = plan.rooms[index]
    return (
        _wall_side(plan, index, axis=0, at=room.x0, inward=1),
        _wall_side(plan, index, axis=0, at=room.x1, inward=-1),
        _wall_side(plan, index, axis=1, at=room.y0, inward=1),
        _wall_side(plan, index, axis=1, at=room.y1, inward=-1),
    )


def _wall_side(plan: FloorPlan, index: int, *, axis: int, at: float, inward: int) -> WallSide:
    room = plan.rooms[index]
    low, high = (room.y0, room.y1) if axis == 0 else (room.x0, room.x1)
    size = (plan.width, plan.depth)[axis]
    doors = [d for d in plan.doorways if index in d.rooms and _lies_on(d, axis, at, low, high)]
    gaps = tuple(sorted((door.low, door.high) for door in doors))
    return WallSide(axis=axis, at=at, inward=inward, low=low, high=high, gaps=gaps, outer=at < 1e-6 or at > size - 1e-6)


def _lies_on(door: Doorway, axis: int, at: float, low: float, high: float) -> bool:
    return door.axis == axis and abs(door.wall - at) < 1e-6 and low <= door.low and door.high <= high


class RoomShell:
    """Builds the fixed parts of the rooms of one apartment."""

    def __init__(
        self,
        builder: SurfaceBuilder,
        occupancy: OccupancyGrid,
        rng: SeededRng,
        materials: ApartmentMaterials,
        height_m: float,
    ) -> None:
        self._builder = builder
        self._occupancy = occupancy
        self._rng = rng
        self._materials = materials
        self._height = height_m
        self.paintings: list[TextureIndex] = []
        """Textures of the paintings hung so far."""

    def draw(self, room: Room, sides: tuple[WallSide, ...], style: RoomMaterials) -> None:
        """Add floor, ceiling, lamp and walls of a room, and block the walls."""
        self._slabs(room, style)
        accent = self._rng.index(4)
        for number, side in enumerate(sides):
            self._wall(side, style.accent if number == accent else style.wall)

    def add_decoration(self, room: Room, side: WallSide, covered: list[tuple[float, float]]) -> None:
        """Add a window and paintings where no tall furniture hides the wall.

        Args:
            room: The room.
            side: One of its walls.
            covered: Intervals (low, high) along the wall that furniture hides.
        """
        taken = list(covered)
        if side.outer and room.kind is not RoomKind.BATH and self._rng.chance(0.8):
            self._add_window(side, taken)
        for _ in range(1 + self._rng.index(3)):
            self.hang_painting(side, taken)

    def decorate_long(self, room: Room, side: WallSide) -> None:
        """Add windows and paintings to the wall of a hall, piece by piece."""
        pieces = max(1, round((side.high - side.low) / _PIECE_OF_WALL_M))
        length = (side.high - side.low) / pieces
        for number in range(pieces):
            low = side.low + number * length
            self.add_decoration(room, replace(side, low=low, high=low + length), [])

    def hang_painting(self, side: WallSide, taken: list[tuple[float, float]]) -> None:
        """Hang a painting on a free part of a wall and add its interval to `taken`; none if six draws find no place."""
        width = self._rng.uniform(0.4, 1.1)
        place = self._free_interval(side, width, taken)
        if place is None:
            return
        height = min(width * self._rng.uniform(0.6, 1.2), 1.0)
        middle = self._rng.uniform(1.15, 1.5)
        painting = self._builder.texture(decals.painting(self._rng))
        self.paintings.append(painting)
        self.mount(side, place, middle - height / 2, middle + height / 2, painting)

    def mount(
        self,
        side: WallSide,
        place: tuple[float, float],
        bottom: float,
        top: float,
        texture: TextureIndex,
        *,
        thick: float = 0.02,
    ) -> None:
        """Fix a plate that shows a texture once to a wall; `place` is its interval (low, high) along the wall."""
        middle = side.face + side.inward * thick / 2
        self._plate(side, middle, thick, *place, bottom, top, texture, None)

    def _slabs(self, room: Room, style: RoomMaterials) -> None:
        x = (room.x0 + room.x1) / 2
        y = (room.y0 + room.y1) / 2
        size = (room.x1 - room.x0, room.y1 - room.y0, 0.04)
        self._builder.box(style.floor, (x, y, -0.02), size, tile_m=style.floor_tile_m)
        self._builder.overhead = True
        self._builder.box(self._materials.ceiling, (x, y, self._height + 0.02), size, tile_m=2.0)
        shade = self._rng.choice(self._materials.cloths)
        self._builder.cylinder(shade, (x, y, self._height - 0.45), 0.22, 0.22, top_radius=0.12)
        self._builder.overhead = False

    def _wall(self, side: WallSide, texture: TextureIndex) -> None:
        for low, high in side.solid_segments():
            self._panel(side, low, high, 0, self._height, texture)
            self._panel(side, low, high, 0, 0.09, self._materials.trim, proud=0.012)
            self._block(side, low, high)
        for low, high in side.gaps:
            self._panel(side, low, high, _DOOR_TOP_M, self._height, texture)
            self._panel(side, low - 0.07, low, 0, _DOOR_TOP_M + 0.07, self._materials.trim, proud=0.02)
            self._panel(side, high, high + 0.07, 0, _DOOR_TOP_M + 0.07, self._materials.trim, proud=0.02)
            self._panel(side, low, high, _DOOR_TOP_M, _DOOR_TOP_M + 0.07, self._materials.trim, proud=0.02)

    def _panel(
        self,
        side: WallSide,
        low: float,
        high: float,
        bottom: float,
        top: float,
        texture: TextureIndex,
        *,
        proud: float = 0.0,
    ) -> None:
        """Add a panel that stands out from the wall's surface by `proud` metres."""
        if high - low < 1e-3:
            return
        back = side.at - side.inward * 2 * _HALF_WALL_M if side.outer else side.at
        front = side.face + side.inward * proud
        self._plate(side, (back + front) / 2, abs(front - back), low, high, bottom, top, texture, self._height)

    def _plate(
        self,
        side: WallSide,
        middle: float,
        thick: float,
        low: float,
        high: float,
        bottom: float,
        top: float,
        texture: TextureIndex,
        tile_m: float | None,
    ) -> None:
        along = (low + high) / 2
        up = (bottom + top) / 2
        if side.axis == 0:
            self._builder.box(texture, (middle, along, up), (thick, high - low, top - bottom), tile_m=tile_m)
        else:
            self._builder.box(texture, (along, middle, up), (high - low, thick, top - bottom), tile_m=tile_m)

    def _block(self, side: WallSide, low: float, high: float) -> None:
        if side.outer or high - low < 1e-3:
            return
        near, far = sorted((side.at, side.face))
        area = (
            FloorRectangle(x0=near, y0=low, x1=far, y1=high)
            if side.axis == 0
            else FloorRectangle(x0=low, y0=near, x1=high, y1=far)
        )
        self._occupancy.block(area)

    def _add_window(self, side: WallSide, taken: list[tuple[float, float]]) -> None:
        width = self._rng.uniform(1.0, 2.0)
        place = self._free_interval(side, width, taken)
        if place is None:
            return
        view = self._builder.texture(decals.window_view(self._rng))
        self.mount(side, place, 0.85, 2.1, view)
        if self._rng.chance(0.7):
            curtain = self._rng.choice(self._materials.cloths)
            for low in (place[0] - 0.3, place[1]):
                self.mount(side, (low, low + 0.3), 0.1, 2.3, curtain, thick=0.04)

    def _free_interval(
        self, side: WallSide, width: float, taken: list[tuple[float, float]]
    ) -> tuple[float, float] | None:
        """Draw a free interval of a width on a wall and add it to `taken`; None if six draws find none."""
        low_end = side.low + 0.35
        high_end = side.high - 0.35 - width
        for _ in range(6):
            if high_end <= low_end:
                return None
            low = self._rng.uniform(low_end, high_end)
            busy = [*taken, *((a - 0.1, b + 0.1) for a, b in side.gaps)]
            if all(low + width + 0.3 < a or low - 0.3 > b for a, b in busy):
                taken.append((low, low + width))
                return low, low + width
        return None
