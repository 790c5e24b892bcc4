"""Where something can be put down so that the robot still gets everywhere."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.boolean_grid import Mask
from ltvn_core.simulation.changes.moved_furniture import piece_cells
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_parts import FurniturePiece

_APRON_M = 0.7
"""Floor on both sides of a doorway on which nothing is put."""
_KEPT_SHARE = 0.97
"""At least this share of the floor that is still wide enough hangs together."""
_TRIES = 40


class Rectangle(NamedTuple):
    """An upright rectangle of floor in metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def middle(self) -> tuple[float, float]:
        """x and y."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2


class FreeFloor:
    """The blocked cells of a scene, with all doors open, while things are put down and taken away."""

    def __init__(self, scene: Scene) -> None:
        """Begin with the scene as it was made."""
        self._clearance = scene.clearance
        self._blocked = scene.clearance.blocked.copy()
        self._aprons = np.zeros_like(self._blocked)
        for doorway in scene.parts.doorways:
            self._aprons[self._cells(_apron(doorway))] = True
        self._placed: dict[str, tuple[slice, slice]] = {}

    def lift(self, piece: FurniturePiece) -> Mask:
        """Take a piece away from where it stood at first; return the cells that it blocked, for `put_back`."""
        cells = piece_cells(piece, self._clearance)
        before = self._blocked[cells].copy()
        self._blocked[cells] = False
        return before

    def put_back(self, name: str, piece: FurniturePiece, cells: Mask) -> bool:
        """Put a piece from wherever it was placed under a name back where it stood at first.

        Returns whether that was possible: something else may stand there now.
        """
        place, elsewhere = piece_cells(piece, self._clearance), self._placed.get(name)
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
        """Put a rectangle of a size in metres down within another one; None where no place is found."""
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
        """Take away what was put down under a name, if anything was."""
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
    """Return whether nearly all of a floor that is wide enough for the robot is one piece."""
    wide = _wide_enough(blocked, resolution_m)
    count, pieces = cv2.connectedComponents(wide.astype(np.uint8), connectivity=4)
    sizes = np.bincount(pieces[wide & floor], minlength=count)
    return bool(sizes.max() >= _KEPT_SHARE * sizes.sum())


def _wide_enough(blocked: Mask, resolution_m: float) -> NDArray[np.bool_]:
    away = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    return (away - 0.5) * resolution_m > PLANNING_CLEARANCE_M


def _apron(door: Doorway) -> Rectangle:
    low, high = door.wall - _APRON_M, door.wall + _APRON_M
    if door.axis == 0:
        return Rectangle(low, door.low, high, door.high)
    return Rectangle(door.low, low, door.high, high)
