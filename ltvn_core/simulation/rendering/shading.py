"""Computes the colours of points on surfaces: a mip-mapped texel times the brightness of the surface.

Does not cast rays.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.rendering.ray_casting import RayHits
from ltvn_core.simulation.rendering.texture_table import MipmapTable
from ltvn_core.simulation.surfaces import Surfaces

BACKGROUND = (30.0, 30.0, 30.0)
"""Colour where a ray leaves the scene."""

_LIGHT = np.array([0.32, 0.23, 0.92], np.float32)
_FLATTEST = 0.15
"""Cosine between ray and normal below which a surface is not blurred any further; floors would lose all texture."""


class Shader:
    """Colours the hits of rays.

    All constants of a face are stored in one row of one table, because one gather is faster than twelve.
    """

    def __init__(self, surfaces: Surfaces, table: MipmapTable | None = None) -> None:
        """Prepare the colours of the surfaces; `table` has their textures, where somebody made it before."""
        self._table = MipmapTable(surfaces.textures) if table is None else table
        self._texture = surfaces.face_texture
        corners = surfaces.vertices[surfaces.faces].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.maximum(np.sqrt((normal**2).sum(1)), 1e-12)
        normal /= area[:, None]
        columns_rows = _texel_coordinates(surfaces, self._table)
        first, along_u, along_v = columns_rows[:, 0], *(columns_rows[:, i] - columns_rows[:, 0] for i in (1, 2))
        texel_area = np.abs(along_u[:, 0] * along_v[:, 1] - along_u[:, 1] * along_v[:, 0])
        texels_per_metre = np.sqrt(texel_area / area)
        self._row = np.column_stack(
            [first, along_u, along_v, normal, texels_per_metre, _light(normal, surfaces.overhead)]
        ).astype(np.float32)
        self._surface = _surface_numbers(surfaces.face_texture, normal, corners[:, 0])

    @property
    def table(self) -> MipmapTable:
        """The textures."""
        return self._table

    def surface_of(self, face: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the surface (N,) of each hit face (N,); faces in one plane with one texture are one surface."""
        return self._surface[face]

    def colours(self, hits: RayHits, directions: NDArray[np.float32], spread: float) -> NDArray[np.float32]:
        """Return the colours (N, 3) in [0, 255] of hits.

        Args:
            hits: Where N rays meet the surfaces.
            directions: (N, 3) directions of the rays.
            spread: Width in metres of a ray's sample at depth 1 m, which decides the mip-map level.
        """
        row = self._row[hits.face]
        column = row[:, 0] + hits.u * row[:, 2] + hits.v * row[:, 4]
        line = row[:, 1] + hits.u * row[:, 3] + hits.v * row[:, 5]
        level = self._levels(row, hits.t, directions, spread)
        colours = self._table.sample(self._texture[hits.face], level, column, line)
        colours *= row[:, 10:11]
        colours[hits.face < 0] = BACKGROUND
        return colours

    def _levels(self, row: NDArray, t: NDArray, directions: NDArray, spread: float) -> NDArray[np.int32]:
        """Return the mip-map levels (N,) at which a sample covers about one texel."""
        facing = np.abs(row[:, 6] * directions[:, 0] + row[:, 7] * directions[:, 1] + row[:, 8] * directions[:, 2])
        steepness = np.sqrt(np.maximum(facing, _FLATTEST))
        with np.errstate(over="ignore"):  # Degenerate triangles of scanned meshes have unbounded texel densities.
            texels = t * np.float32(spread) * row[:, 9] / steepness
        texels = np.clip(texels, 1, 2 ** (self._table.levels - 1))
        # The exponent of a positive float is the whole part of its binary logarithm.
        return (np.ascontiguousarray(texels, np.float32).view(np.int32) >> 23) - 127


def _texel_coordinates(surfaces: Surfaces, table: MipmapTable) -> NDArray[np.float64]:
    """Return column and row (F, 3, 2) of each corner; rows run downwards."""
    sizes = table.sizes()[surfaces.face_texture].astype(np.float64)[:, None, :]
    uv = surfaces.corner_uv.astype(np.float64)
    # Whole repeats are subtracted, so that no coordinate is negative and single precision suffices within a face.
    columns = uv[..., 0] - np.floor(uv[..., 0].min(1, keepdims=True))
    rows = np.ceil(uv[..., 1].max(1, keepdims=True)) - uv[..., 1]
    return np.stack([columns, rows], -1) * sizes


def _light(normal: NDArray[np.float64], overhead: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the brightness (F,) under a soft light from above and one side, so that neighbouring walls differ."""
    lambert = np.abs(normal @ (_LIGHT / np.sqrt((_LIGHT**2).sum())))
    light = (0.70 + 0.30 * lambert) * (1 - 0.10 * np.abs(normal[:, 0]))
    return np.where(overhead, 0.97, light)


def _surface_numbers(texture: NDArray, normal: NDArray, point: NDArray) -> NDArray[np.int32]:
    offset = (normal * point).sum(1)
    key = np.column_stack([texture, np.rint(normal * 20), np.rint(offset * 100)]).astype(np.int64)
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)
