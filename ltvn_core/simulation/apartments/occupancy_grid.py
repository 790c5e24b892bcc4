"""What stands on an apartment's floor, on a 5 cm grid, and whether a robot still gets everywhere.

Owns the blocked cells and the rule that free floor stays one piece. Draws nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, Doorway, FloorPlan
from ltvn_core.simulation.boolean_grid import connected_components, distance_transform
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M

MARGIN_CELLS = 4
"""Blocked cells around the floor: the outer walls."""

_DOOR_APRON_M = 0.7
"""Floor on both sides of a doorway on which nothing may stand."""


@dataclass(frozen=True, slots=True)
class FloorRectangle:
    """A part of the floor in metres; edges lie on the grid."""

    x0: float
    y0: float
    x1: float
    y1: float


class OccupancyGrid:
    """The floor of an apartment while it is furnished."""

    def __init__(self, plan: FloorPlan) -> None:
        """Begin with outer walls alone."""
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
        """Put something there, whatever follows."""
        self.blocked[self._cells(area)] = True

    def try_block(self, area: FloorRectangle) -> bool:
        """Put something there if the place is free, no doorway is obstructed and free floor stays one piece."""
        cells = self._cells(area)
        if self.blocked[cells].any() or self._aprons[cells].any():
            return False
        self.blocked[cells] = True
        if self.is_connected():
            return True
        self.blocked[cells] = False
        return False

    def is_connected(self) -> bool:
        """Tell whether a robot gets from any place where it can stand to any other."""
        room = distance_transform(~self.blocked) - 0.5
        _, pieces = connected_components(room * GRID_STEP_M > PLANNING_CLEARANCE_M)
        return pieces == 1

    def _cells(self, area: FloorRectangle) -> tuple[slice, slice]:
        x0, y0, x1, y1 = (round(edge / GRID_STEP_M) + MARGIN_CELLS for edge in (area.x0, area.y0, area.x1, area.y1))
        return slice(max(y0, 0), max(y1, 0)), slice(max(x0, 0), max(x1, 0))


def _apron(door: Doorway) -> FloorRectangle:
    low, high = door.wall - _DOOR_APRON_M, door.wall + _DOOR_APRON_M
    if door.axis == 0:
        return FloorRectangle(x0=low, y0=door.low, x1=high, y1=door.high)
    return FloorRectangle(x0=door.low, y0=low, x1=door.high, y1=high)
