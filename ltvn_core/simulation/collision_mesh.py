"""The collision mesh of a scene: the blocked cells of its clearance map, extruded to blocks.

Physics uses this mesh and not the visible surfaces, so that it agrees with planning about every cell.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import ClearanceMap

_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
_FACES = np.array(
    [[0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7], [4, 5, 6], [4, 6, 7]]
)


def extrude_blocked_cells(clearance: ClearanceMap, height_m: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (V, 3) in metres and faces (F, 3) of blocks of a height that cover all blocked cells.

    The blocks have no bottom: nothing can reach it.
    """
    blocks = np.array(list(_rectangles(clearance.blocked)), np.float64).reshape(-1, 2, 2)
    low = blocks[:, 0] * clearance.resolution_m + clearance.origin
    high = blocks[:, 1] * clearance.resolution_m + clearance.origin
    low3 = np.column_stack([low, np.zeros(len(blocks))])
    high3 = np.column_stack([high, np.full(len(blocks), height_m)])
    vertices = low3[:, None] + _CORNERS * (high3 - low3)[:, None]
    faces = _FACES + 8 * np.arange(len(blocks))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32)


def _rectangles(blocked: NDArray[np.bool_]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Cover the blocked cells with rectangles ((column, row), (column, row)), greedily: first right, then up.

    Merging cells keeps the number of triangles low, which decides how fast the physics runs.
    """
    uncovered = blocked.copy()
    rectangles = []
    for row, column in np.argwhere(blocked):
        if not uncovered[row, column]:
            continue
        end = column + 1
        while end < uncovered.shape[1] and uncovered[row, end]:
            end += 1
        top = row + 1
        while top < uncovered.shape[0] and uncovered[top, column:end].all():
            top += 1
        uncovered[row:top, column:end] = False
        rectangles.append(((column, row), (end, top)))
    return rectangles
