"""Distance transform and connected components of boolean grids, as typed wrappers around `scipy.ndimage`."""

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Mask = NDArray[np.bool_]
"""(rows, columns) cells of a grid that are true or false."""


def distance_transform(cells: Mask) -> NDArray[np.float64]:
    """Return the distance (rows, columns) in cells to the nearest false cell; 0 in false cells."""
    return cast(NDArray[np.float64], ndimage.distance_transform_edt(cells))


def nearest_true(cells: Mask) -> NDArray[np.intp]:
    """Return row and column (2, rows, columns) of the true cell nearest to each cell."""
    nearest = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    return cast(NDArray[np.int32], nearest).astype(np.intp)


def connected_components(cells: Mask) -> tuple[NDArray[np.int32], int]:
    """Label the connected components of true cells (4 neighbours).

    Returns:
        The number of each cell's component (rows, columns), from 1 on and 0 in false cells, and how many there are.
    """
    numbers, count = cast(Any, ndimage.label(cells))
    return numbers, int(count)
