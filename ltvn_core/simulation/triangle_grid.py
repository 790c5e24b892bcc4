"""Triangles cut to a band of heights and seen from above, found by place and measured exactly.

A wall seen from above is a line, the top of a table an area: both are triangles in the plane, the former flat ones.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_STRIDE = 1 << 24
"""Between the numbers of two columns of cells; more than any scene has rows."""
_FLAT_M2 = 1e-10


class TriangleGrid:
    """Triangles in the plane in a uniform grid of cells."""

    def __init__(self, triangles: NDArray[np.floating], *, low_m: float, high_m: float, cell_m: float) -> None:
        """Cut triangles (T, 3, 3) to the heights between `low_m` and `high_m`, and sort them into cells.

        Args:
            triangles: In metres, z up.
            low_m: Lower end of the band.
            high_m: Upper end of the band.
            cell_m: Side of a cell.
        """
        below = _cut_above(triangles.astype(np.float64).reshape(-1, 3, 3), high_m)
        inside = _cut_above(below * (1, 1, -1), -low_m)
        self._triangles = inside[:, :, :2]
        self._cell_m = cell_m
        self._keys, self._rows = self._sorted_into_cells()

    def near(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Return the triangles (N, 3, 2) that reach into the cell of a point or one of its eight neighbours."""
        column, row = int(np.floor(x_m / self._cell_m)), int(np.floor(y_m / self._cell_m))
        edges = [(column + step) * _STRIDE + row + side for step in (-1, 0, 1) for side in (-1, 2)]
        found = np.searchsorted(self._keys, edges)
        rows = np.concatenate([self._rows[found[k] : found[k + 1]] for k in (0, 2, 4)])
        return self._triangles[np.unique(rows)]

    def _sorted_into_cells(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the cells' numbers, sorted, and which triangle reaches into each; a large one into many."""
        first = np.floor(self._triangles.min(axis=1) / self._cell_m).astype(np.int64)
        last = np.floor(self._triangles.max(axis=1) / self._cell_m).astype(np.int64)
        columns, rows = (last - first + 1).T
        triangle = np.repeat(np.arange(len(first)), columns * rows)
        begin = np.repeat(np.cumsum(columns * rows) - columns * rows, columns * rows)
        column, row = np.divmod(np.arange(len(triangle)) - begin, rows[triangle])
        keys = (first[triangle, 0] + column) * _STRIDE + first[triangle, 1] + row
        order = np.argsort(keys, kind="stable")
        return keys[order], triangle[order]


class Outlines:
    """A few triangles near a point: their edges, and the areas of those that are not flat."""

    def __init__(self, edges: NDArray[np.float64], areas: NDArray[np.float64]) -> None:
        """Take edges (E, 4), each x0, y0, x1 and y1, and triangles with an area (A, 3, 2)."""
        self._x, self._y = edges[:, 0], edges[:, 1]
        self._dx, self._dy = edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]
        length2 = np.maximum(self._dx**2 + self._dy**2, 1e-18)
        self._sx, self._sy = self._dx / length2, self._dy / length2
        self._areas = areas

    def nearest(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return the distance from a point to the nearest of them and its nearest point; 0 within an area."""
        if len(self._areas) and _contains(self._areas, np.array([x_m, y_m])).any():
            return 0.0, x_m, y_m
        to_x, to_y = x_m - self._x, y_m - self._y
        share = to_x * self._sx
        share += to_y * self._sy
        np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
        to_x -= share * self._dx
        to_y -= share * self._dy
        distance2 = to_x * to_x
        distance2 += to_y * to_y
        k = int(distance2.argmin())
        return math.sqrt(distance2[k]), x_m - float(to_x[k]), y_m - float(to_y[k])


def near_outlines(
    triangles: Sequence[NDArray[np.float64]], x_m: float, y_m: float, *, within_m: float
) -> Outlines | None:
    """Return the outlines of triangles (N, 3, 2) within a distance of a point; None if none is so near."""
    point = np.array([x_m, y_m])
    all_triangles = np.concatenate([*triangles, np.zeros((0, 3, 2))])
    starts, ends = all_triangles, all_triangles[:, (1, 2, 0)]
    along = ends - starts
    share = ((point - starts) * along).sum(2) / np.maximum((along**2).sum(2), 1e-18)
    to_edge = point - starts - np.clip(share, 0, 1)[..., None] * along
    is_near = (to_edge**2).sum(2) < within_m**2
    edges = np.concatenate([starts, ends], axis=2)[is_near]
    areas = all_triangles[is_near.any(axis=1) | _contains(all_triangles, point)]
    areas = areas[np.abs(_doubled_areas(areas)) > _FLAT_M2]
    if not len(edges) and not len(areas):
        return None
    # Neighbours share edges, and a wall is seen from above as many triangles that are one line.
    flipped = (edges[:, 0] > edges[:, 2]) | ((edges[:, 0] == edges[:, 2]) & (edges[:, 1] > edges[:, 3]))
    edges[flipped] = edges[flipped][:, (2, 3, 0, 1)]
    return Outlines(np.unique(edges, axis=0), areas)


def _cut_above(triangles: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    """Return the parts of triangles (T, 3, 3) at or below a height, as triangles again."""
    above = triangles[:, :, 2] > height_m
    count = above.sum(axis=1)
    is_cut = (count == 1) | (count == 2)
    cut = triangles[is_cut]
    # Begin with the corner that is alone on its side, so that the plane crosses both edges that leave it.
    alone = (above[is_cut] == (count[is_cut] == 1)[:, None]).argmax(axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    corner, second, third = np.moveaxis(np.take_along_axis(cut, order[..., None], axis=1), 1, 0)
    crossings = [
        corner + (end - corner) * ((height_m - corner[:, 2]) / (end[:, 2] - corner[:, 2]))[:, None]
        for end in (second, third)
    ]
    is_tip = count[is_cut] == 2
    tips = np.stack([corner, *crossings], axis=1)[is_tip]
    stumps = [np.stack([crossings[0], second, third], axis=1), np.stack([crossings[0], third, crossings[1]], axis=1)]
    return np.concatenate([triangles[count == 0], tips, *(part[~is_tip] for part in stumps)])


def _contains(triangles: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (T,): in which triangles (T, 3, 2) a point lies."""
    along, to_point = np.roll(triangles, -1, axis=1) - triangles, point - triangles
    sides = along[..., 0] * to_point[..., 1] - along[..., 1] * to_point[..., 0]
    return np.logical_or((sides > 0).all(axis=1), (sides < 0).all(axis=1))


def _doubled_areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
