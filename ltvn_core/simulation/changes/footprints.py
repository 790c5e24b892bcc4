"""Which cells of the floor something solid blocks, from its triangles, by the rule of generated apartments."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.simulation.triangle_rasterization import RasterGrid, clip_to_heights

_FLAT_M = 0.03
"""The robot drives over anything lower than this."""
_FINE = 5
"""Subdivisions of a cell's side when its covered share is measured."""
_COVERED_SHARE = 0.5
"""A cell is blocked if at least this share of it is covered."""


class Cells(NamedTuple):
    """Cells of a grid."""

    rows: NDArray[np.intp]
    """(N,)."""
    columns: NDArray[np.intp]
    """(N,)."""


def blocked_cells(surfaces: Surfaces, clearance: ClearanceMap) -> Cells:
    """Return the cells of a clearance map that something blocks; what it encloses is blocked, too."""
    triangles = clip_to_heights(surfaces.vertices[surfaces.faces].astype(np.float64), _FLAT_M, OBSTACLE_HEIGHT_M)
    if not len(triangles):
        return Cells(np.empty(0, np.intp), np.empty(0, np.intp))
    size_m = clearance.resolution_m
    corners = (triangles[:, :, :2].reshape(-1, 2) - clearance.origin) / size_m
    limits = np.array(clearance.blocked.shape[::-1])
    low = np.clip(np.floor(corners.min(0)).astype(np.intp) - 1, 0, limits)
    high = np.clip(np.ceil(corners.max(0)).astype(np.intp) + 1, 0, limits)
    columns, rows = (high - low).tolist()
    if columns <= 0 or rows <= 0:
        return Cells(np.empty(0, np.intp), np.empty(0, np.intp))
    raster = RasterGrid(clearance.origin + low * size_m, (rows * _FINE, columns * _FINE), size_m / _FINE)
    covered = np.asarray(ndimage.binary_fill_holes(raster.cover(triangles)))
    share = covered.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3))
    found_rows, found_columns = np.nonzero(share >= _COVERED_SHARE)
    return Cells(found_rows + low[1], found_columns + low[0])
