"""The blocked cells of an apartment's floor, on a 5 cm grid.

Guarantees that the free floor stays connected for a robot. Makes no geometry.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, FloorPlan
from ltvn_core.simulation.boolean_grid import connected_components, distance_transform
from ltvn_core.simulation.rooms import Doorway

MARGIN_CELLS = 4
"""Blocked cells around the floor: the outer walls."""

MIN_PASSAGE_CLEARANCE_M = 0.22
"""Least clearance of a passage. It belongs to the generator, not to a robot: seeds must make the same apartments."""

_DOOR_APRON_M = 0.7
"""Floor on both sides of a doorway on which nothing may stand."""


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
        columns, rows = round(plan.width / GRID_STEP_M), round(plan.depth / GRID_STEP_M)
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
    low, high = door.wall - _DOOR_APRON_M, door.wall + _DOOR_APRON_M
    if door.axis == 0:
        return FloorRectangle(x0=low, y0=door.low, x1=high, y1=door.high)
    return FloorRectangle(x0=door.low, y0=low, x1=door.high, y1=high)
