"""Rasterizes triangles from above onto a grid of the floor, and clips them to a range of heights."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import Mask

Triangles = NDArray[np.floating]
"""(F, 3, 3) corners in metres."""

_FRACTION_BITS = 8
"""Number of fractional bits of OpenCV's fixed-point coordinates."""


@dataclass(frozen=True, eq=False)
class RasterGrid:
    """A grid over the floor; rows run along y, columns along x."""

    origin: NDArray[np.float64]
    """(2,) its lower corner in metres."""
    shape: tuple[int, int]
    """Rows and columns."""
    cell_m: float

    def cover(self, triangles: Triangles) -> Mask:
        """Return the cells (rows, columns) that triangles (F, 3, 3) touch; a vertical triangle covers a line."""
        image = np.zeros(self.shape, np.uint8)
        points = (triangles[:, :, :2] - self.origin) / self.cell_m
        small = np.ptp(points, axis=1).max(axis=1, initial=0.0) < 1.0
        self._dot(image, points[small])
        # OpenCV counts from the centre of the first pixel, this grid from the corner of the first cell. The clipping
        # keeps stray corners inside OpenCV's 32-bit coordinates.
        fixed = np.clip(np.rint((points[~small] - 0.5) * 2**_FRACTION_BITS), -(2**30), 2**30).astype(np.int32)
        for triangle in fixed:
            cv2.fillConvexPoly(image, triangle, 1, cv2.LINE_8, _FRACTION_BITS)
        return image.astype(bool)

    def _dot(self, image: NDArray[np.uint8], points: NDArray[np.float64]) -> None:
        """Mark the corners and centroids of triangles smaller than a cell; they touch no other cells."""
        dots = np.concatenate([points.reshape(-1, 2), points.mean(axis=1)])
        column, row = np.floor(dots).astype(np.intp).T
        inside = (column >= 0) & (row >= 0) & (column < self.shape[1]) & (row < self.shape[0])
        image[row[inside], column[inside]] = 1


def clip_to_heights(triangles: Triangles, low_m: float, high_m: float) -> Triangles:
    """Return the parts of triangles (F, 3, 3) that lie between two heights in metres."""
    z = triangles[:, :, 2]
    near = triangles[(z.max(axis=1) > low_m) & (z.min(axis=1) < high_m)]
    z = near[:, :, 2]
    whole = (z.min(axis=1) >= low_m) & (z.max(axis=1) <= high_m)
    cut = near[~whole]
    for height, up in ((low_m, 1.0), (high_m, -1.0)):
        if len(cut) and np.isfinite(height):
            corners = cut.reshape(-1, 3)
            faces = np.arange(3 * len(cut)).reshape(-1, 3)
            from trimesh.intersections import slice_faces_plane  # Takes long, and few scenes are cut.

            sliced = slice_faces_plane(corners, faces, [0, 0, up], [0, 0, height])
            cut = np.asarray(sliced[0])[np.asarray(sliced[1])].reshape(-1, 3, 3)
    return np.concatenate([near[whole], cut])
