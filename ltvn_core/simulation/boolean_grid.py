"""Distances and connected pieces on grids of cells that are true or false.

Owns nothing but the shapes and types of what scipy answers.
"""

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Mask = NDArray[np.bool_]


def distance_transform(cells: Mask) -> NDArray[np.float64]:
    """Return the distance (rows, columns) in cells to the nearest false cell; 0 in false cells."""
    return cast(NDArray[np.float64], ndimage.distance_transform_edt(cells))


def nearest_true(cells: Mask) -> NDArray[np.intp]:
    """Return row and column (2, rows, columns) of the true cell nearest to each cell."""
    nearest = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    return cast(NDArray[np.int32], nearest).astype(np.intp)


def connected_components(cells: Mask) -> tuple[NDArray[np.int32], int]:
    """Number the pieces of true cells that share edges, from 1 on; return (rows, columns) and their count."""
    numbers, count = cast(Any, ndimage.label(cells))
    return numbers, int(count)
