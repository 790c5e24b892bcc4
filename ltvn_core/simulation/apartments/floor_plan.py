"""The floor plan of an apartment: its rooms, corridors and doorways, on a 5 cm grid.

Divides a rectangle into rooms that are all connected, and decides the purpose of each room. Makes no geometry.
Coordinates are metres; the inner floor of the apartment spans (0, 0) to (width, depth). Inner walls are 10 cm thick and
centred on the common edges of rooms, outer walls stand outside.

The blocked cells of the floor are on the same grid; the free floor stays connected for a robot.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.clearance_map import connected_components, distance_transform
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind

GRID_STEP_M = 0.05
"""Grid step in metres. Everything that blocks the floor has its edges on multiples of it, so that the clearance map is
exact."""

MIN_DOORWAY_M = 0.9


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """Rooms that tile a rectangle, and the doorways that connect them."""

    width: float
    depth: float
    rooms: tuple[Room, ...]
    doorways: tuple[Doorway, ...]


def generate_floor_plan(rng: SeededRng, area_m2: float) -> FloorPlan:
    """Return a floor plan of connected rooms with a given area (45 to 130 m2)."""
    width = snap((area_m2 * rng.uniform(1.1, 1.6)) ** 0.5)
    depth = snap(area_m2 / width)
    for _ in range(40):
        trial = rng.spawn()
        layout = trial.choice(_LAYOUTS)(trial, width, depth)
        rooms = _assign_kinds(trial, layout)
        doorways = _draw_doorways(trial, rooms)
        if doorways is not None and min(room.shorter_side_m for room in rooms) >= 1.3:
            return mirrored(FloorPlan(width=width, depth=depth, rooms=rooms, doorways=doorways), trial)
    return _row_of_rooms(rng, width, depth)


def snap(metres: float) -> float:
    """Return the nearest length on the grid."""
    return round(round(metres / GRID_STEP_M) * GRID_STEP_M, 6)


def _hall(x0: float, y0: float, x1: float, y1: float) -> Room:
    return Room(kind=RoomKind.HALL, x0=snap(x0), y0=snap(y0), x1=snap(x1), y1=snap(y1))


def _split(rng: SeededRng, block: Room, room_area_m2: float) -> list[Room]:
    """Halve a block across its longer side repeatedly, until its rooms have about the given area."""
    x0 = block.x0
    y0 = block.y0
    x1 = block.x1
    y1 = block.y1
    longer = max(x1 - x0, y1 - y0)
    if block.area_m2 < 1.5 * room_area_m2 or longer < 4.2:
        return [block]
    cut = rng.uniform(0.4, 0.6) if longer > 5.5 else rng.choice((0.44, 0.5, 0.56))
    if x1 - x0 > y1 - y0:
        middle = snap(x0 + cut * longer)
        parts = replace(block, x1=middle), replace(block, x0=middle)
    else:
        middle = snap(y0 + cut * longer)
        parts = replace(block, y1=middle), replace(block, y0=middle)
    return [room for part in parts for room in _split(rng, part, room_area_m2)]


def _spine(rng: SeededRng, width: float, depth: float) -> list[Room]:
    """Return a large room at one end, and a corridor from it between two rows of rooms."""
    corridor = rng.uniform_multiple(1.3, 1.6)
    one_row = depth < 5.4 + corridor
    low = 0.0 if one_row else snap((depth - corridor) * rng.uniform(0.42, 0.58))
    start = snap(width * rng.uniform(0.34, 0.44))
    end = snap(width - 3.2) if width - start > 8.0 and rng.chance(0.6) else width
    rooms = [_hall(start, low, end, low + corridor)]
    room_area_m2 = rng.uniform(9, 14)
    blocks = [_hall(start, low + corridor, end, depth)]
    if not one_row:
        blocks.append(_hall(start, 0, end, low))
    if end < width:
        rooms.append(_hall(end, 0, width, depth))
        rooms.extend(_split(rng, rooms.pop(), 18))
    for block in blocks:
        rooms.extend(_split(rng, block, room_area_m2))
    front = _hall(0, 0, start, depth)
    return rooms + _split(rng, front, rng.uniform(14, 24))


def _elbow(rng: SeededRng, width: float, depth: float) -> list[Room]:
    """Return a corridor with a corner, and three blocks of rooms around it."""
    corridor = rng.uniform_multiple(1.3, 1.6)
    low = snap(max(2.7, depth * rng.uniform(0.36, 0.46)))
    high = snap(low + corridor)
    right = snap(width * rng.uniform(0.5, 0.62))
    left = snap(right - corridor)
    room_area_m2 = rng.uniform(10, 15)
    blocks = [_hall(0, 0, width, low), _hall(0, high, left, depth), _hall(right, low, width, depth)]
    halls = [_hall(0, low, right, high), _hall(left, high, right, depth)]
    return halls + [room for block in blocks for room in _split(rng, block, room_area_m2)]


def _open(rng: SeededRng, width: float, depth: float) -> list[Room]:
    """Return a small entrance hall, and rooms that lead into each other."""
    deep = rng.uniform_multiple(2.0, 3.0)
    broad = rng.uniform_multiple(1.5, 2.0)
    at = snap(width * rng.uniform(0.35, 0.6))
    blocks = [_hall(0, 0, at, depth), _hall(at, deep, width, depth), _hall(at + broad, 0, width, deep)]
    room_area_m2 = rng.uniform(12, 18)
    return [_hall(at, 0, at + broad, deep)] + [room for block in blocks for room in _split(rng, block, room_area_m2)]


_LAYOUTS: tuple[Callable[[SeededRng, float, float], list[Room]], ...] = (_spine, _spine, _elbow, _open)


def _assign_kinds(rng: SeededRng, layout: list[Room]) -> tuple[Room, ...]:
    """Make the largest room the living room and the smallest the bathroom, and shuffle the kinds of the others."""
    halls = {i for i, room in enumerate(layout) if room.shorter_side_m < 1.75 or (i == 0 and room.area_m2 < 7)}
    others = sorted((i for i in range(len(layout)) if i not in halls), key=lambda i: -layout[i].area_m2)
    kinds = {i: RoomKind.HALL for i in halls}
    if others:
        kinds[others.pop(0)] = RoomKind.LIVING
    if others:
        kinds[others.pop()] = RoomKind.BATH
    kinds_left = [RoomKind.KITCHEN, RoomKind.BEDROOM]
    kinds_left += rng.shuffled([RoomKind.STUDY, RoomKind.NURSERY, RoomKind.DINING, RoomKind.BEDROOM, RoomKind.LIBRARY])
    if len(others) > 6:
        kinds[others.pop()] = RoomKind.BATH
    for order, i in enumerate(others):
        kinds[i] = kinds_left[order % len(kinds_left)]
    return tuple(replace(room, kind=kinds[i]) for i, room in enumerate(layout))


def _draw_doorways(rng: SeededRng, rooms: tuple[Room, ...]) -> tuple[Doorway, ...] | None:
    """Draw doorways that connect all rooms, through corridors where possible; None if they cannot be connected.

    A minimum spanning tree (Kruskal) by preference, plus some doorways that close loops.
    """
    candidates = [c for a, b in combinations(range(len(rooms)), 2) if (c := common_wall(rooms, a, b)) is not None]
    candidates = sorted(rng.shuffled(candidates), key=lambda gap: _preference(rooms, gap))
    group = list(range(len(rooms)))  # Number of the connected component of each room.
    chosen: list[Doorway] = []
    for gap in candidates:
        a, b = (group[i] for i in gap.rooms)
        if a != b:
            group = [a if g == b else g for g in group]
        elif not rng.chance(0.3) or _is_private(rooms, gap):
            continue
        chosen.append(_narrowed(rng, rooms, gap))
    return tuple(chosen) if len(set(group)) == 1 else None


def common_wall(rooms: tuple[Room, ...], a: int, b: int) -> Doorway | None:
    """Return the whole segment of wall that two rooms share as a doorway; None if no door fits into it."""
    p = rooms[a]
    q = rooms[b]
    for axis, (p_low, p_high, q_low, q_high, along) in enumerate(
        (
            (p.x0, p.x1, q.x0, q.x1, (max(p.y0, q.y0), min(p.y1, q.y1))),
            (p.y0, p.y1, q.y0, q.y1, (max(p.x0, q.x0), min(p.x1, q.x1))),
        )
    ):
        for wall, other in ((p_high, q_low), (p_low, q_high)):
            if abs(wall - other) < 1e-6 and along[1] - along[0] > MIN_DOORWAY_M + 0.35:
                return Doorway(rooms=(a, b), axis=axis, wall=wall, low=along[0], high=along[1])
    return None


def _preference(rooms: tuple[Room, ...], gap: Doorway) -> int:
    """Return the rank of a doorway; doorways of a smaller rank are chosen first."""
    kinds = {rooms[i].kind for i in gap.rooms}
    if kinds == {RoomKind.HALL} or kinds == {RoomKind.LIVING, RoomKind.KITCHEN}:
        return 0
    if RoomKind.HALL in kinds:
        return 1
    return 3 if RoomKind.BATH in kinds else 2


def _is_private(rooms: tuple[Room, ...], gap: Doorway) -> bool:
    """Whether a doorway leads to a bathroom or joins two corridors; such doorways close no loops."""
    kinds = {rooms[i].kind for i in gap.rooms}
    return RoomKind.BATH in kinds or kinds == {RoomKind.HALL}


_OPEN_PLAN_KINDS = {RoomKind.HALL, RoomKind.LIVING, RoomKind.KITCHEN, RoomKind.DINING, RoomKind.LIBRARY}


def _narrowed(rng: SeededRng, rooms: tuple[Room, ...], gap: Doorway) -> Doorway:
    """Cut a doorway out of the wall that two rooms share."""
    kinds = {rooms[i].kind for i in gap.rooms}
    available = gap.high - gap.low - 0.3
    width = rng.uniform_multiple(MIN_DOORWAY_M, 1.0)
    if kinds == {RoomKind.HALL}:
        width = available
    elif kinds <= _OPEN_PLAN_KINDS and rng.chance(0.6):
        width = rng.uniform_multiple(1.2, 2.0)
    width = snap(min(width, available))
    low = rng.uniform_multiple(gap.low + 0.15, gap.high - 0.15 - width)
    return replace(gap, low=snap(low), high=snap(low + width))


def mirrored(plan: FloorPlan, rng: SeededRng) -> FloorPlan:
    """Return the plan with each of its two axes flipped, and the axes exchanged, with a probability of one half."""
    for axis in (0, 1):
        if rng.chance(0.5):
            plan = _flipped(plan, axis)
    return _transposed(plan) if rng.chance(0.5) else plan


def _flipped(plan: FloorPlan, axis: int) -> FloorPlan:
    size = (plan.width, plan.depth)[axis]

    def flip(value: float) -> float:
        return snap(size - value)

    def flip_door(door: Doorway) -> Doorway:
        if door.axis == axis:
            return replace(door, wall=flip(door.wall))
        return replace(door, low=flip(door.high), high=flip(door.low))

    if axis == 0:
        rooms = tuple(replace(room, x0=flip(room.x1), x1=flip(room.x0)) for room in plan.rooms)
    else:
        rooms = tuple(replace(room, y0=flip(room.y1), y1=flip(room.y0)) for room in plan.rooms)
    return replace(plan, rooms=rooms, doorways=tuple(flip_door(door) for door in plan.doorways))


def _transposed(plan: FloorPlan) -> FloorPlan:
    rooms = tuple(Room(kind=room.kind, x0=room.y0, y0=room.x0, x1=room.y1, y1=room.x1) for room in plan.rooms)
    doorways = tuple(replace(door, axis=1 - door.axis) for door in plan.doorways)
    return FloorPlan(width=plan.depth, depth=plan.width, rooms=rooms, doorways=doorways)


def _row_of_rooms(rng: SeededRng, width: float, depth: float) -> FloorPlan:
    """Return a plan of rooms side by side, the fallback that is always possible."""
    count = max(2, int(width // 3.2))
    edges = [snap(width * i / count) for i in range(count + 1)]
    layout = [Room(kind=RoomKind.BEDROOM, x0=edges[i], y0=0.0, x1=edges[i + 1], y1=depth) for i in range(count)]
    rooms = _assign_kinds(rng, layout)
    gaps = [common_wall(rooms, i, i + 1) for i in range(count - 1)]
    return FloorPlan(
        width=width,
        depth=depth,
        rooms=rooms,
        doorways=tuple(_narrowed(rng, rooms, gap) for gap in gaps if gap is not None),
    )


MARGIN_CELLS = 4
"""Blocked cells around the floor: the outer walls."""

MIN_PASSAGE_CLEARANCE_M = 0.22
"""Least clearance of a passage. It belongs to the generator, not to a robot: seeds must make the same apartments."""

_DOOR_APRON_M = 0.7
"""Depth of the floor on both sides of a doorway on which nothing may stand, in metres."""


@dataclass(frozen=True, slots=True)
class FloorRectangle:
    """A rectangle of floor in metres; its edges lie on the grid."""

    x0: float
    y0: float
    x1: float
    y1: float


class OccupancyGrid:
    """The free and blocked cells of an apartment while it is furnished."""

    def __init__(self, plan: FloorPlan) -> None:
        """Create a grid in which only the outer walls are blocked."""
        columns = round(plan.width / GRID_STEP_M)
        rows = round(plan.depth / GRID_STEP_M)
        self.blocked = np.ones((rows + 2 * MARGIN_CELLS, columns + 2 * MARGIN_CELLS), bool)
        self.blocked[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS] = False
        self._aprons = np.zeros_like(self.blocked)
        for doorway in plan.doorways:
            self._aprons[self._cells(_apron(doorway))] = True

    @property
    def origin(self) -> NDArray[np.float64]:
        """(2,) x and y of the grid's lower corner in metres."""
        return np.full(2, -MARGIN_CELLS * GRID_STEP_M)

    def block(self, area: FloorRectangle) -> None:
        """Block a rectangle without any check, as for walls."""
        self.blocked[self._cells(area)] = True

    def try_block(self, area: FloorRectangle) -> bool:
        """Block a rectangle if it is free, keeps doorways clear and leaves the free floor connected.

        Returns:
            Whether the rectangle was blocked.
        """
        cells = self._cells(area)
        if self.blocked[cells].any() or self._aprons[cells].any():
            return False
        self.blocked[cells] = True
        if self.is_connected():
            return True
        self.blocked[cells] = False
        return False

    def is_connected(self) -> bool:
        """Return whether the navigable floor is one connected component."""
        clearance_cells = distance_transform(~self.blocked) - 0.5
        _, count = connected_components(clearance_cells * GRID_STEP_M > MIN_PASSAGE_CLEARANCE_M)
        return count == 1

    def _cells(self, area: FloorRectangle) -> tuple[slice, slice]:
        x0, y0, x1, y1 = (round(edge / GRID_STEP_M) + MARGIN_CELLS for edge in (area.x0, area.y0, area.x1, area.y1))
        return slice(max(y0, 0), max(y1, 0)), slice(max(x0, 0), max(x1, 0))


def _apron(door: Doorway) -> FloorRectangle:
    """Return the floor on both sides of a doorway that stays clear."""
    low = door.wall - _DOOR_APRON_M
    high = door.wall + _DOOR_APRON_M
    if door.axis == 0:
        return FloorRectangle(x0=low, y0=door.low, x1=high, y1=door.high)
    return FloorRectangle(x0=door.low, y0=low, x1=door.high, y1=high)
