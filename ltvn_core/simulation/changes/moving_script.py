"""Furniture that is moved, removed and returned, and things that are left on the floor.

Owns the places for things, which keep the whole floor reachable for the robot.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core import worlds as w
from ltvn_core.simulation.changes.changed_scenes import piece_cells
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, TimedChange
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, Mask
from ltvn_core.simulation.rooms import Doorway, FurniturePiece, Room
from ltvn_core.simulation.scene import Scene

_APRON_M = 0.7
"""Length of floor on both sides of a doorway that stays free, in metres."""
_KEPT_SHARE = 0.97
"""Least share of the passable floor that stays connected."""
_TRIES = 40
MEAN_PAUSE_S = HOUR_S
"""Mean time between two changes while people are awake, in seconds."""
_AWAKE_H = (7.0, 23.0)
BUILT_IN = ("counter", "fridge", "bathtub", "toilet", "basin", "goods-shelf", "till")
"""Prefixes of the names of furniture that is never moved."""
_MOST_MOVED_SHARE = 0.25
"""Greatest share of the furniture that is moved or removed at the same time."""
_MOST_THINGS = 6
_HEIGHT_M = 1.0
_THINGS = (
    (w.ThingKind.BOX, (0.35, 0.6), (0.3, 0.7)),
    (w.ThingKind.BASKET, (0.35, 0.5), (0.4, 0.6)),
    (w.ThingKind.CHAIR, (0.42, 0.5), (0.85, 0.95)),
)
"""Things that are left on the floor: kind, range of sides and range of height, in metres."""


class Rectangle(NamedTuple):
    """An axis-aligned rectangle of floor; lengths in metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def middle(self) -> tuple[float, float]:
        """x and y of the middle, in metres."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2


class FreeFloor:
    """The blocked cells of a scene with all doors open, updated as things are placed and removed."""

    def __init__(self, scene: Scene) -> None:
        """Start with the unchanged scene."""
        self._clearance = scene.clearance
        self._blocked = scene.clearance.blocked.copy()
        self._aprons = np.zeros_like(self._blocked)
        for doorway in scene.parts.doorways:
            self._aprons[self._cells(_apron(doorway))] = True
        self._placed: dict[str, tuple[slice, slice]] = {}

    def lift(self, piece: FurniturePiece) -> Mask:
        """Remove a piece from its original place; return the cells that it blocked, for `put_back`."""
        cells = piece_cells(piece, self._clearance)
        before = self._blocked[cells].copy()
        self._blocked[cells] = False
        return before

    def put_back(self, name: str, piece: FurniturePiece, cells: Mask) -> bool:
        """Move a named piece back to its original place.

        Returns False if another thing is there now.
        """
        place = piece_cells(piece, self._clearance)
        elsewhere = self._placed.get(name)
        blocked = self._blocked.copy()
        if elsewhere is not None:
            blocked[elsewhere] = False
        if (blocked[place] & cells).any():
            return False
        blocked[place] |= cells
        self._blocked = blocked
        self._placed.pop(name, None)
        return True

    def place(
        self, name: str, within: Rectangle, size: tuple[float, float], rng: np.random.Generator
    ) -> Rectangle | None:
        """Place a rectangle with sides `size` in metres within another rectangle; return None if there is no room."""
        spare = within.x1 - within.x0 - size[0], within.y1 - within.y0 - size[1]
        if min(spare) <= 0:
            return None
        for low in rng.uniform((within.x0, within.y0), np.add((within.x0, within.y0), spare), (_TRIES, 2)):
            place = Rectangle(*low.tolist(), *(low + size).tolist())
            cells = self._cells(place)
            if self._fits(cells):
                self._placed[name] = cells
                self._blocked[cells] = True
                return place
        return None

    def remove(self, name: str) -> None:
        """Remove the thing that was placed under a name, if there is any."""
        if name in self._placed:
            self._blocked[self._placed.pop(name)] = False

    def _fits(self, cells: tuple[slice, slice]) -> bool:
        if self._blocked[cells].any() or self._aprons[cells].any():
            return False
        blocked = self._blocked.copy()
        blocked[cells] = True
        return _hangs_together(blocked, self._clearance.resolution_m, self._clearance.navigable)

    def _cells(self, area: Rectangle) -> tuple[slice, slice]:
        low = (np.array(area[:2]) - self._clearance.origin) / self._clearance.resolution_m
        high = (np.array(area[2:]) - self._clearance.origin) / self._clearance.resolution_m
        (x0, y0), (x1, y1) = np.maximum(np.floor(low), 0).astype(int), np.maximum(np.ceil(high), 0).astype(int)
        return slice(y0, y1), slice(x0, x1)


def _hangs_together(blocked: Mask, resolution_m: float, floor: Mask) -> bool:
    """Return whether nearly all of the floor that is wide enough for the robot is connected."""
    wide = _wide_enough(blocked, resolution_m)
    count, pieces = cv2.connectedComponents(wide.astype(np.uint8), connectivity=4)
    sizes = np.bincount(pieces[wide & floor], minlength=count)
    return bool(sizes.max() >= _KEPT_SHARE * sizes.sum())


def _wide_enough(blocked: Mask, resolution_m: float) -> NDArray[np.bool_]:
    away = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    return (away - 0.5) * resolution_m > PLANNING_CLEARANCE_M


def _apron(door: Doorway) -> Rectangle:
    low = door.wall - _APRON_M
    high = door.wall + _APRON_M
    if door.axis == 0:
        return Rectangle(low, door.low, high, door.high)
    return Rectangle(door.low, low, door.high, high)


def moved_things(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return the changes of furniture and things over time; the robot can still reach the whole floor."""
    household = _Household(scene, rng)
    changes: list[TimedChange] = []
    now_s = 0.0
    while (now_s := now_s + rng.exponential(MEAN_PAUSE_S)) < duration_s:
        if _AWAKE_H[0] * HOUR_S <= now_s % DAY_S < _AWAKE_H[1] * HOUR_S:
            changes += [TimedChange(now_s, change) for change in household.next_change()]
    return changes


class _Household:
    """Current places of furniture and things while a script is generated."""

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        self._rooms: Sequence[Room] = scene.rooms
        self._pieces = [piece for piece in scene.parts.furniture if piece.name.rpartition("-")[0] not in BUILT_IN]
        self._floor = FreeFloor(scene)
        self._rng = rng
        self._elsewhere: dict[str, tuple[FurniturePiece, Mask]] = {}
        """Moved or removed pieces, and the cells that they blocked at their original places."""
        self._things: list[str] = []
        self._count = 0

    def next_change(self) -> list[w.WorldChange]:
        """Return the next changes; empty if there is no room for them."""
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
        """Move a piece within its room, or remove it if there is no room for it."""
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
