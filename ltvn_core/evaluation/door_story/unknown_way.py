"""A path over the floor of a scene that a map lacks, possibly after a piece of furniture was removed.

A map with only one path cannot change its plan. After the robot was driven along such a missing path once, the map has
two paths. Reads the clearance map to set up the story.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import lengths_along
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes, piece_cells
from ltvn_core.simulation.changes.moving_script import BUILT_IN
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap, Mask, connected_components
from ltvn_core.simulation.rooms import Doorway, FurniturePiece
from ltvn_core.simulation.scene import Scene
from ltvn_core.worlds import OWN_PREFIX, DoorMoved, ThingRemoved, WorldState

UNKNOWN_M = 0.7
"""Distance from all nodes beyond which the floor counts as not mapped, in metres."""
_BESIDE_DOOR_M = 0.6
"""Distance from a door at which the paths around it begin and end, in metres."""
_POINTS_IN_DOOR = 20
_LEAST_UNKNOWN_M, _MOST_UNKNOWN_M = 0.8, 6.0
"""Least and greatest length of the unmapped part of a path, in metres."""
_BEFORE_M, _BEYOND_M = 0.9, 1.6
"""Lengths of the drive on mapped floor before and after the unmapped part, in metres."""
_DOOR_NEAR_M = 1.5
"""Distance before the unmapped part, in metres: if a door is nearer than this, the drive begins on the other side of
the door."""


@dataclass(frozen=True, slots=True, eq=False)
class UnknownWay:
    """A path along which the robot is driven once."""

    path: NDArray[np.float64]
    """(M, 2) x and y in metres; it begins and ends on floor that is in the map."""
    moved_away: str | None
    """Name of the piece of furniture that blocks the path at first; None if nothing does."""

    @property
    def length_m(self) -> float:
        """Length of the path in metres."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())


def find_unknown_way(scene: Scene, state: WorldState, mapped: NDArray[np.float64]) -> UnknownWay | None:
    """Return the shortest path that the map lacks and that closes a loop with mapped paths through doors.

    `mapped` are the positions (N, 2) of the nodes. Paths without furniture to remove are preferred. Returns None if
    there is no path.
    """
    scenes = ChangedScenes(scene)
    here = scenes.at(state)
    found = [way for each in _loops(here, scenes, state) if (way := _unknown_part(*each, here, mapped)) is not None]
    return min(found, key=lambda way: (way.moved_away is not None, way.length_m), default=None)


def _loops(here: Scene, scenes: ChangedScenes, state: WorldState) -> Iterator[tuple[NDArray[np.float64], str | None]]:
    """Yield paths (M, 2) around a door from one side to the other, and the furniture to remove for each."""
    elsewhere = state.missing | {thing.thing for thing in state.things}
    leaves = [_leaf_cells(here.clearance, doorway) for doorway in here.parts.doors]
    for piece in (None, *(each for each in here.parts.furniture if _can_go(each, elsewhere))):
        name = None if piece is None else OWN_PREFIX + piece.name
        wide = _wide_enough(here.clearance, piece)
        for door, doorway in enumerate(here.parts.doors):
            if door in state.closed_doors or not _leads_round(wide & ~leaves[door], here.clearance, doorway):
                continue
            after = state if name is None else state.after(ThingRemoved(name))
            floor = scenes.at(after.after(DoorMoved(door, is_open=False))).clearance
            path = floor.path(*_sides(doorway))
            if path is not None:
                yield np.vstack([path, np.linspace(path[-1], path[0], _POINTS_IN_DOOR)[1:]]), name
                break  # Other doors of the same loop would give the same way.


def _can_go(piece: FurniturePiece, elsewhere: Collection[str]) -> bool:
    return piece.name.rpartition("-")[0] not in BUILT_IN and OWN_PREFIX + piece.name not in elsewhere


def _wide_enough(clearance: ClearanceMap, piece: FurniturePiece | None) -> Mask:
    """Return the cells with room for a robot after a piece is removed."""
    blocked = clearance.blocked.copy()
    if piece is not None:
        blocked[piece_cells(piece, clearance)] = False
    return ClearanceMap(blocked, clearance.origin, clearance.resolution_m).grid > PLANNING_CLEARANCE_M


def _leads_round(floor: Mask, clearance: ClearanceMap, doorway: Doorway) -> bool:
    """Tell whether the floor cells (rows, columns) connect both sides of a door."""
    pieces, _ = connected_components(floor)
    one, other = (pieces[_cell(clearance, side)] for side in _sides(doorway))
    return bool(one and one == other)


def _leaf_cells(clearance: ClearanceMap, doorway: Doorway) -> Mask:
    """Return the cells in which a robot would touch a closed door."""
    rows, columns = clearance.blocked.shape
    x = clearance.origin[0] + (np.arange(columns) + 0.5) * clearance.resolution_m
    y = clearance.origin[1] + (np.arange(rows) + 0.5) * clearance.resolution_m
    across, along = (x[None, :], y[:, None]) if doorway.axis == 0 else (y[:, None], x[None, :])
    beside = (along > doorway.low) & (along < doorway.high)
    return (np.abs(across - doorway.wall) < PLANNING_CLEARANCE_M) & beside


def _sides(doorway: Doorway) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    away = np.eye(2)[doorway.axis] * _BESIDE_DOOR_M
    return np.array(doorway.middle) - away, np.array(doorway.middle) + away


def _cell(clearance: ClearanceMap, point: NDArray[np.float64]) -> tuple[int, int]:
    column, row = np.floor((point - clearance.origin) / clearance.resolution_m).astype(int).tolist()
    rows, columns = clearance.blocked.shape
    return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)


def _unknown_part(
    loop: NDArray[np.float64], moved_away: str | None, scene: Scene, mapped: NDArray[np.float64]
) -> UnknownWay | None:
    """Return the unmapped part of a loop (M, 2), with the mapped path before and after it; None if its length is
    unsuitable."""
    away_m = np.hypot(*(loop[:-1, None] - mapped[None]).transpose(2, 0, 1)).min(1)
    to_middle = len(away_m) // 2 - int(away_m.argmax())
    loop, away_m = np.roll(loop[:-1], to_middle, axis=0), np.roll(away_m, to_middle)
    at_m = lengths_along(loop)
    unknown = np.flatnonzero(away_m > UNKNOWN_M)
    if not len(unknown):
        return None
    first_m = at_m[unknown[0]]
    last_m = at_m[unknown[-1]]
    if not _LEAST_UNKNOWN_M < last_m - first_m < _MOST_UNKNOWN_M:
        return None
    passed = [door.middle for door in scene.parts.doors if _is_on(loop, door)]
    doors_m = (float(at_m[np.hypot(*(loop - middle).T).argmin()]) for middle in passed)
    near_m = (door_m for door_m in doors_m if first_m - _DOOR_NEAR_M < door_m < first_m)
    begin_m = max((door_m for door_m in near_m if door_m > _BEFORE_M), default=first_m) - _BEFORE_M
    kept = (at_m >= begin_m) & (at_m <= last_m + _BEYOND_M)
    return UnknownWay(loop[kept], moved_away)


def _is_on(path: NDArray[np.float64], doorway: Doorway) -> bool:
    return bool(np.hypot(*(path - doorway.middle).T).min() < doorway.width_m / 2 + 0.1)
