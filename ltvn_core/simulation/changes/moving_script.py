"""Furniture that is moved, taken away and brought back, and things that are left lying about."""

from collections.abc import Sequence

import numpy as np

from ltvn_core.simulation.boolean_grid import Mask
from ltvn_core.simulation.changes.free_floor import FreeFloor, Rectangle
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, TimedChange
from ltvn_core.simulation.rooms import Room
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_parts import FurniturePiece
from ltvn_core.worlds import world_change as w

MEAN_PAUSE_S = HOUR_S
"""Something is moved once an hour on average, while people are awake."""
_AWAKE_H = (7.0, 23.0)
BUILT_IN = ("counter", "fridge", "bathtub", "toilet", "basin")
"""Furniture of these kinds, by the beginnings of its names, nobody moves."""
_MOST_MOVED_SHARE = 0.25
"""At most this share of the furniture is elsewhere at once."""
_MOST_THINGS = 6
_HEIGHT_M = 1.0
_THINGS = (
    (w.ThingKind.BOX, (0.35, 0.6), (0.3, 0.7)),
    (w.ThingKind.BASKET, (0.35, 0.5), (0.4, 0.6)),
    (w.ThingKind.CHAIR, (0.42, 0.5), (0.85, 0.95)),
)
"""What is left lying about: kind, range of its sides, range of its height in metres."""


def moved_things(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return what is moved, taken away, brought back and left lying about; the robot still gets everywhere."""
    household = _Household(scene, rng)
    changes: list[TimedChange] = []
    now_s = 0.0
    while (now_s := now_s + rng.exponential(MEAN_PAUSE_S)) < duration_s:
        if _AWAKE_H[0] * HOUR_S <= now_s % DAY_S < _AWAKE_H[1] * HOUR_S:
            changes += [TimedChange(now_s, change) for change in household.next_change()]
    return changes


class _Household:
    """What stands where, while a script is written."""

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        self._rooms: Sequence[Room] = scene.rooms
        self._pieces = [piece for piece in scene.parts.furniture if piece.name.rpartition("-")[0] not in BUILT_IN]
        self._floor = FreeFloor(scene)
        self._rng = rng
        self._elsewhere: dict[str, tuple[FurniturePiece, Mask]] = {}
        """Pieces that are not where they stood at first, and the cells that they blocked there."""
        self._things: list[str] = []
        self._count = 0

    def next_change(self) -> list[w.WorldChange]:
        """Return the next thing that happens; nothing where there is no room for it."""
        fewest = len(self._things) < _MOST_THINGS
        if not self._pieces or self._rng.random() < 0.5:
            return self._leave_something() if fewest and self._rng.random() < 0.65 else self._clear_away()
        if len(self._elsewhere) < _MOST_MOVED_SHARE * len(self._pieces) and self._rng.random() < 0.6:
            return self._move_piece()
        return self._bring_back()

    def _leave_something(self) -> list[w.WorldChange]:
        kind, sides, heights = _THINGS[self._rng.integers(len(_THINGS))]
        name = f"{kind}-{self._count}"
        width, depth, height = (round(float(self._rng.uniform(*limits)), 2) for limits in (sides, sides, heights))
        room = self._rooms[int(self._rng.integers(len(self._rooms)))]
        place = self._floor.place(name, _inside(room), (width, depth), self._rng)
        if place is None:
            return []
        self._count += 1
        self._things.append(name)
        yaw = float(self._rng.integers(4)) * np.pi / 2
        size = (width, depth, height) if yaw % np.pi < 1 else (depth, width, height)
        return [w.ThingPlaced(name, kind, (*place.middle, yaw), size)]

    def _clear_away(self) -> list[w.WorldChange]:
        if not self._things:
            return []
        name = self._things.pop(int(self._rng.integers(len(self._things))))
        self._floor.remove(name)
        return [w.ThingRemoved(name)]

    def _move_piece(self) -> list[w.WorldChange]:
        """Move a piece within its room, or take it away where there is no room for it."""
        piece = self._pieces[int(self._rng.integers(len(self._pieces)))]
        name = w.OWN_PREFIX + piece.name
        room = _room_of(piece, self._rooms)
        if name in self._elsewhere or room is None:
            return []
        self._elsewhere[name] = piece, self._floor.lift(piece)
        quarter = int(self._rng.integers(4))
        size = (piece.width, piece.depth) if quarter % 2 == 0 else (piece.depth, piece.width)
        place = self._floor.place(name, _inside(room), size, self._rng)
        if place is None:
            return [w.ThingRemoved(name)]
        pose = (*place.middle, quarter * np.pi / 2)
        return [w.ThingPlaced(name, w.ThingKind.FURNITURE, pose, (piece.width, piece.depth, _HEIGHT_M))]

    def _bring_back(self) -> list[w.WorldChange]:
        if not self._elsewhere:
            return []
        name = [*self._elsewhere][int(self._rng.integers(len(self._elsewhere)))]
        piece, cells = self._elsewhere[name]
        if not self._floor.put_back(name, piece, cells):
            return []
        del self._elsewhere[name]
        return [w.ThingReturned(name)]


def _inside(room: Room) -> Rectangle:
    return Rectangle(room.x0, room.y0, room.x1, room.y1)


def _room_of(piece: FurniturePiece, rooms: Sequence[Room]) -> Room | None:
    return next((r for r in rooms if r.x0 < piece.x < r.x1 and r.y0 < piece.y < r.y1), None)
