"""The shell of a room: floor, ceiling, walls with doorways, windows and pictures on them.

Owns what is fixed. Inner walls are drawn by each of their two rooms, half and half, so that each has its own wallpaper.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from ltvn_core.sim import pictures
from ltvn_core.sim.builder import SurfaceBuilder, Texture
from ltvn_core.sim.dice import Dice
from ltvn_core.sim.floorplan import Doorway, FloorPlan, Room, RoomKind
from ltvn_core.sim.footprint import Footprint, Rectangle
from ltvn_core.sim.style import Household, RoomStyle

_HALF_WALL_M = 0.05
_DOOR_TOP_M = 2.05


@dataclass(frozen=True, slots=True)
class Side:
    """One wall of a room, seen from inside."""

    axis: int
    """0 for a wall along y, 1 for a wall along x."""
    at: float
    """Where the wall's middle stands on that axis."""
    inward: int
    """+1 if the room lies on the larger side."""
    low: float
    high: float
    gaps: tuple[tuple[float, float], ...]
    """Doorways in it, in order."""
    outer: bool

    @property
    def face(self) -> float:
        """Where the wall's surface is on its axis."""
        return self.at if self.outer else self.at + self.inward * _HALF_WALL_M

    def solid(self) -> Iterator[tuple[float, float]]:
        """Yield the stretches between doorways."""
        cursor = self.low
        for low, high in self.gaps:
            yield cursor, low
            cursor = high
        yield cursor, self.high


def sides_of(plan: FloorPlan, index: int) -> tuple[Side, ...]:
    """Return the four walls of a room."""
    room = plan.rooms[index]
    spans = ((0, room.x0, 1, room.y0, room.y1), (0, room.x1, -1, room.y0, room.y1))
    spans += ((1, room.y0, 1, room.x0, room.x1), (1, room.y1, -1, room.x0, room.x1))
    return tuple(_side(plan, index, *span) for span in spans)


def _side(plan: FloorPlan, index: int, axis: int, at: float, inward: int, low: float, high: float) -> Side:
    size = (plan.width, plan.depth)[axis]
    doors = [d for d in plan.doorways if index in d.rooms and _on(d, axis, at, low, high)]
    gaps = tuple(sorted((door.low, door.high) for door in doors))
    return Side(axis, at, inward, low, high, gaps, outer=at < 1e-6 or at > size - 1e-6)


def _on(door: Doorway, axis: int, at: float, low: float, high: float) -> bool:
    return door.axis == axis and abs(door.wall - at) < 1e-6 and low <= door.low and door.high <= high


class Shell:
    """Draws the fixed parts of one room."""

    def __init__(
        self, builder: SurfaceBuilder, footprint: Footprint, dice: Dice, household: Household, height_m: float
    ) -> None:
        self._builder, self._footprint, self._dice = builder, footprint, dice
        self._household, self._height = household, height_m

    def draw(self, room: Room, sides: tuple[Side, ...], style: RoomStyle) -> None:
        """Draw floor, ceiling, lamp and walls."""
        self._slabs(room, style)
        accent = self._dice.index(4)
        for number, side in enumerate(sides):
            self._wall(side, style.accent if number == accent else style.wall)

    def hang(self, room: Room, side: Side, covered: list[tuple[float, float]]) -> None:
        """Hang a window and pictures where no tall furniture covers the wall."""
        taken = list(covered)
        if side.outer and room.kind is not RoomKind.BATH and self._dice.chance(0.8):
            self._window(side, taken)
        for _ in range(1 + self._dice.index(3)):
            self._picture(side, taken)

    def _slabs(self, room: Room, style: RoomStyle) -> None:
        x, y = (room.x0 + room.x1) / 2, (room.y0 + room.y1) / 2
        size = (room.x1 - room.x0, room.y1 - room.y0, 0.04)
        self._builder.box(style.floor, (x, y, -0.02), size, tile_m=style.floor_tile_m)
        self._builder.overhead = True
        self._builder.box(self._household.ceiling, (x, y, self._height + 0.02), size, tile_m=2.0)
        shade = self._dice.pick(self._household.cloths)
        self._builder.cylinder(shade, (x, y, self._height - 0.45), 0.22, 0.22, top_radius=0.12)
        self._builder.overhead = False

    def _wall(self, side: Side, texture: Texture) -> None:
        for low, high in side.solid():
            self._panel(side, low, high, 0, self._height, texture)
            self._panel(side, low, high, 0, 0.09, self._household.trim, proud=0.012)
            self._block(side, low, high)
        for low, high in side.gaps:
            self._panel(side, low, high, _DOOR_TOP_M, self._height, texture)
            self._panel(side, low - 0.07, low, 0, _DOOR_TOP_M + 0.07, self._household.trim, proud=0.02)
            self._panel(side, high, high + 0.07, 0, _DOOR_TOP_M + 0.07, self._household.trim, proud=0.02)
            self._panel(side, low, high, _DOOR_TOP_M, _DOOR_TOP_M + 0.07, self._household.trim, proud=0.02)

    def _panel(
        self, side: Side, low: float, high: float, bottom: float, top: float, texture: Texture, *, proud: float = 0.0
    ) -> None:
        """Add a stretch of wall, `proud` metres thicker than the wall."""
        if high - low < 1e-3:
            return
        back = side.at - side.inward * 2 * _HALF_WALL_M if side.outer else side.at
        front = side.face + side.inward * proud
        self._plate(side, (back + front) / 2, abs(front - back), low, high, bottom, top, texture, self._height)

    def _plate(
        self,
        side: Side,
        middle: float,
        thick: float,
        low: float,
        high: float,
        bottom: float,
        top: float,
        texture: Texture,
        tile_m: float | None,
    ) -> None:
        along, up = (low + high) / 2, (bottom + top) / 2
        if side.axis == 0:
            self._builder.box(texture, (middle, along, up), (thick, high - low, top - bottom), tile_m=tile_m)
        else:
            self._builder.box(texture, (along, middle, up), (high - low, thick, top - bottom), tile_m=tile_m)

    def _block(self, side: Side, low: float, high: float) -> None:
        if side.outer or high - low < 1e-3:
            return
        near, far = sorted((side.at, side.face))
        area = Rectangle(near, low, far, high) if side.axis == 0 else Rectangle(low, near, high, far)
        self._footprint.block(area)

    def _window(self, side: Side, taken: list[tuple[float, float]]) -> None:
        width = self._dice.uniform(1.0, 2.0)
        place = self._free_stretch(side, width, taken)
        if place is None:
            return
        view = self._builder.texture(pictures.window_view(self._dice))
        self._mount(side, place, 0.85, 2.1, view)
        if self._dice.chance(0.7):
            curtain = self._dice.pick(self._household.cloths)
            for low in (place[0] - 0.3, place[1]):
                self._mount(side, (low, low + 0.3), 0.1, 2.3, curtain, thick=0.04)

    def _picture(self, side: Side, taken: list[tuple[float, float]]) -> None:
        width = self._dice.uniform(0.4, 1.1)
        place = self._free_stretch(side, width, taken)
        if place is None:
            return
        height, middle = min(width * self._dice.uniform(0.6, 1.2), 1.0), self._dice.uniform(1.15, 1.5)
        picture = self._builder.texture(pictures.painting(self._dice))
        self._mount(side, place, middle - height / 2, middle + height / 2, picture)

    def _free_stretch(self, side: Side, width: float, taken: list[tuple[float, float]]) -> tuple[float, float] | None:
        """Find room of a width on a wall, away from doorways and what hangs or stands there, and take it."""
        low_end, high_end = side.low + 0.35, side.high - 0.35 - width
        for _ in range(6):
            if high_end <= low_end:
                return None
            low = self._dice.uniform(low_end, high_end)
            busy = [*taken, *((a - 0.1, b + 0.1) for a, b in side.gaps)]
            if all(low + width + 0.3 < a or low - 0.3 > b for a, b in busy):
                taken.append((low, low + width))
                return low, low + width
        return None

    def _mount(
        self,
        side: Side,
        place: tuple[float, float],
        bottom: float,
        top: float,
        texture: Texture,
        *,
        thick: float = 0.02,
    ) -> None:
        middle = side.face + side.inward * thick / 2
        self._plate(side, middle, thick, *place, bottom, top, texture, None)
