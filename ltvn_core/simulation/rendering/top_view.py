"""A scene seen straight from above with its ceiling cut away, as a plan on paper.

Owns the one orthographic picture; the robot's own camera is in `camera`.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.ray_casting import RayCaster
from ltvn_core.simulation.rendering.shading import Shader
from ltvn_core.simulation.scene import Scene
from ltvn_core.types import Rgb

_CUT_M = 2.3
"""Rays start here: above all furniture and below the walls' tops, so that walls show as plain bands."""

_DOORWAY_CUT_M = 2.0
"""Over free floor rays start below the lintels, so that doorways show as gaps."""

_SUPERSAMPLING = 2


def top_view(scene: Scene, pixels_per_metre: float) -> Rgb:
    """Return a picture (H, W, 3) of the floor; x grows to the right, y upwards, and its edges are the grid's.

    Raises ValueError unless `pixels_per_metre` is positive.
    """
    if not pixels_per_metre > 0:
        raise ValueError(f"A plan needs a positive number of pixels per metre, got {pixels_per_metre}.")
    surfaces = scene.surfaces.without_overhead()
    fine = pixels_per_metre * _SUPERSAMPLING
    height, width = (int(side * pixels_per_metre) for side in _sides_m(scene.clearance))
    origins = _lattice(scene.clearance, height * _SUPERSAMPLING, width * _SUPERSAMPLING, fine)
    down = np.tile(np.array([0, 0, -1], np.float32), (len(origins), 1))
    hits = RayCaster(surfaces.vertices, surfaces.faces).cast(origins, down)
    # Parallel rays do not spread, so each sample is as wide as one at depth 1.
    hits = hits._replace(t=np.ones_like(hits.t))
    colours = Shader(surfaces).colours(hits, down, 1 / fine)
    blocks = colours.reshape(height, _SUPERSAMPLING, width, _SUPERSAMPLING, 3)
    return np.rint(blocks.mean((1, 3))).astype(np.uint8)


def _sides_m(clearance: ClearanceMap) -> tuple[float, float]:
    rows, columns = clearance.blocked.shape
    return rows * clearance.resolution_m, columns * clearance.resolution_m


def _lattice(clearance: ClearanceMap, rows: int, columns: int, pixels_per_metre: float) -> NDArray[np.float32]:
    """Return where the rays (rows * columns, 3) begin, row by row from the top."""
    column, row = (np.arange(columns) + 0.5) / pixels_per_metre, (np.arange(rows)[::-1] + 0.5) / pixels_per_metre
    cells = [np.floor(place / clearance.resolution_m).astype(np.intp) for place in (row, column)]
    height = np.where(clearance.blocked[np.ix_(*cells)], _CUT_M, _DOORWAY_CUT_M)
    x, y = clearance.origin[0] + column, clearance.origin[1] + row
    return np.column_stack([np.tile(x, rows), np.repeat(y, columns), height.ravel()]).astype(np.float32)
