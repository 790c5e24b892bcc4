"""Which cells of an apartment something really stands in: a round pot leaves the corners of its square to the robot.

Owns that correction of the grid on which furniture is placed, so that little is in the way that no camera could see.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M
from ltvn_core.simulation.boolean_grid import Mask, connected_components
from ltvn_core.simulation.scene import OBSTACLE_HEIGHT_M
from ltvn_core.simulation.triangle_rasterization import RasterGrid, Triangles, clip_to_heights

_RUG_M = 0.03
"""What is lower than this is driven over."""
_FINE = 5
"""Parts of a cell's edge."""
_MOST = 0.5
"""A cell is free if more than this share of it is."""


def cells_really_blocked(blocked: Mask, origin: NDArray[np.float64], triangles: Triangles) -> Mask:
    """Return those of the `blocked` cells (rows, columns) in which, or behind which, something stands.

    `origin` (2,) is the grid's lower corner in metres, `triangles` (F, 3, 3) is all there is to see.
    """
    rows, columns = blocked.shape
    raster = RasterGrid(origin, (rows * _FINE, columns * _FINE), GRID_STEP_M / _FINE)
    open_parts = ~raster.cover(clip_to_heights(triangles, _RUG_M, OBSTACLE_HEIGHT_M))
    # The inside of a shelf is empty too, but there is no way into it.
    pieces, _ = connected_components(open_parts)
    floor = open_parts & ~blocked.repeat(_FINE, axis=0).repeat(_FINE, axis=1)
    entered = open_parts & np.isin(pieces, np.unique(pieces[floor]))
    share = entered.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3))
    return blocked & (share <= _MOST)
