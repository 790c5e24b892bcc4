"""The RGB-D renderer by ray casting with Embree, with antialiasing.

The colour of a point is a mip-mapped texel times the brightness of its surface. All textures lie in one flat table, so
that one gather colours all pixels. Knows surfaces, but neither rooms nor robots.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.simulation.rendering.ray_casting import RayCaster, RayHits, Rays, pixel_rays
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces
from ltvn_core.types import Depth, Pose, Rgb

BACKGROUND = (30.0, 30.0, 30.0)
"""Colour of rays that leave the scene."""
_LIGHT = np.array([0.32, 0.23, 0.92], np.float32)
_FLATTEST = 0.15
"""Cosine between ray and normal below which a surface is not blurred further; otherwise floors would lose all
texture."""
MAX_DEPTH_M = 10.0
"""Range of the depth camera; depth is 0 beyond it."""
_SURFACES_PER_LAYER = 1 << 26
"""Offset between the numbers of surfaces in two layers."""


class MipmapTable:
    """Textures, each with its mip-maps down to one pixel. Sides are powers of two."""

    def __init__(self, textures: tuple[Rgb, ...]) -> None:
        """Store textures (H, W, 3) and compute their mip-maps.

        Raises:
            ValueError: A side is not a power of two.
        """
        chains = [_halvings(texture) for texture in textures]
        self.levels = max(len(chain) for chain in chains)
        """Number of mip-map levels; a small texture repeats its last level."""
        self._entries = np.zeros((len(textures) * self.levels, 4), np.int32)
        images: list[NDArray[np.float32]] = []
        end = 0
        for texture, chain in enumerate(chains):
            for level in range(self.levels):
                image = chain[min(level, len(chain) - 1)]
                height, width = image.shape[:2]
                if level < len(chain):
                    images.append(image.reshape(-1, 3))
                    end += height * width
                self._entries[texture * self.levels + level] = (
                    end - height * width,
                    width - 1,
                    height - 1,
                    width.bit_length() - 1,
                )
        self._texels = np.concatenate(images)

    def sizes(self) -> NDArray[np.float32]:
        """Return (T, 2): width and height of each texture in pixels."""
        return (self._entries[:: self.levels, 1:3] + 1).astype(np.float32)

    def sample(
        self,
        texture: NDArray[np.int32],
        level: NDArray[np.int32],
        column: NDArray[np.floating],
        row: NDArray[np.floating],
    ) -> NDArray[np.float32]:
        """Return the colours (N, 3) at columns and rows (N,) of the full-size texture; both wrap around."""
        entry = self._entries[texture * np.int32(self.levels) + level]
        # Columns are never negative, so cutting the fraction off and shifting is a division rounded down.
        column_at = (column.astype(np.int32) >> level) & entry[:, 1]
        row_at = (row.astype(np.int32) >> level) & entry[:, 2]
        return self._texels[entry[:, 0] + (row_at << entry[:, 3]) + column_at]


def _halvings(texture: Rgb) -> list[NDArray[np.float32]]:
    """Return a texture and its mip-maps, each half as wide and high as the one before, down to one pixel."""
    height, width = texture.shape[:2]
    if height & (height - 1) or width & (width - 1):
        raise ValueError(f"The width and height of a texture must be powers of two, got {width} x {height}.")
    chain = [texture.astype(np.float32)]
    while max(chain[-1].shape[:2]) > 1:
        image = chain[-1]
        if image.shape[0] > 1:
            image = (image[0::2] + image[1::2]) / 2
        if image.shape[1] > 1:
            image = (image[:, 0::2] + image[:, 1::2]) / 2
        chain.append(image.astype(np.float32, copy=False))
    return chain


class Shader:
    """Colours the hits of rays.

    All constants of a face are stored in one row of one table, because one gather is faster than twelve.
    """

    def __init__(self, surfaces: Surfaces, table: MipmapTable | None = None) -> None:
        """Prepare the colours of the surfaces; `table` has their textures if it was created before."""
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


class VisibleScene(Protocol):
    """The visible state of a scene at one time."""

    @property
    def surfaces(self) -> Surfaces:
        """Surfaces of the scene itself."""
        ...

    @property
    def added(self) -> tuple[Surfaces, ...]:
        """Surfaces added to the scene."""
        ...

    @property
    def light(self) -> Light:
        """Light of the scene."""
        ...


class _Layer(NamedTuple):
    """Indexed surfaces for ray casting. The scene has one layer; added surfaces have another, because they are few."""

    surfaces: Surfaces
    caster: RayCaster
    shader: Shader


class _Met(NamedTuple):
    """Hits of some of N rays in one layer."""

    layer: _Layer
    number: int
    """Number of the layer."""
    rays: NDArray[np.intp] | slice
    """Indices of the rays."""
    hits: RayHits


class _Seen(NamedTuple):
    """Hits of N rays. Colours are computed on demand, because they cost more than everything else."""

    directions: NDArray[np.float32]
    """(N, 3)"""
    depth: NDArray[np.float32]
    """(N,) metres along the optical axis, 0 without a hit."""
    met: tuple[_Met, ...]
    """Hits per layer: of all rays in the first one, and nearer hits in later ones."""

    def surfaces(self) -> NDArray[np.int32]:
        """Return the numbers (N,) of the surfaces."""
        numbers = np.empty(len(self.depth), np.int32)
        for layer, number, rays, hits in self.met:
            numbers[rays] = layer.shader.surface_of(hits.face) + number * _SURFACES_PER_LAYER
        return numbers

    def colours(self, spread: float) -> NDArray[np.float32]:
        """Return colours (N, 3) in [0, 255] for samples that are `spread` metres wide at depth 1 m."""
        colours = np.empty((len(self.depth), 3), np.float32)
        for layer, _, rays, hits in self.met:
            colours[rays] = layer.shader.colours(hits, self.directions[rays], spread)
        return colours


class EmbreeRenderer:
    """Casts one ray through the centre of each pixel, and a grid of `supersampling` squared rays where surfaces
    meet. Implements `ltvn_core.types.Renderer`."""

    def __init__(self, surfaces: Surfaces, *, supersampling: int = 2) -> None:
        """Index the surfaces.

        Args:
            surfaces: The surfaces to render.
            supersampling: Rays per side of a pixel at edges of surfaces; 1 leaves edges jagged.

        Raises:
            ImportError: Embree is not installed.
        """
        self._look = _Look((_layer(surfaces, ()),), PLAIN_LIGHT)
        self._supersampling = supersampling

    def show(self, scene: VisibleScene) -> None:
        """Render another state of the scene from now on; only changed surfaces are indexed. Any thread may call it."""
        known = self._look.layers
        layers = tuple(_layer(surfaces, known) for surfaces in (scene.surfaces, *scene.added))
        self._look = _Look(layers, scene.light)

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) and depth (H, W) in metres along the optical axis, 0 beyond 10 m."""
        colours, depth = self.measure(pose, camera)
        return colours(), depth

    def measure(self, pose: Pose, camera: CameraModel) -> tuple[Callable[[], Rgb], Depth]:
        """Return the same depth, and a function that renders the same rgb of the current scene, now or later."""
        look = self._look  # Another thread may change the state during the measurement.
        pose = np.array(pose)
        seen = _trace(look.layers, pose, camera, pixel_rays(camera))
        depth = np.where(seen.depth <= MAX_DEPTH_M, seen.depth, np.float32(0))
        return partial(self._rgb, look, seen, pose, camera), depth.reshape(camera.height, camera.width)

    def _rgb(self, look: "_Look", seen: _Seen, pose: Pose, camera: CameraModel) -> Rgb:
        shape = (camera.height, camera.width)
        colours = seen.colours(1 / camera.fx)
        if self._supersampling > 1:
            boundaries = _surface_boundaries(seen.surfaces().reshape(shape))
            self._antialias(look.layers, colours, np.flatnonzero(boundaries), pose, camera)
        return np.rint(_lit(colours, look.light)).astype(np.uint8).reshape(*shape, 3)

    def _antialias(
        self,
        layers: tuple[_Layer, ...],
        colours: NDArray[np.float32],
        pixels: NDArray[np.intp],
        pose: Pose,
        lens: CameraModel,
    ) -> None:
        """Replace the colours of `pixels` by the mean over a regular grid of rays within each."""
        centre = pixel_rays(lens)
        n = self._supersampling
        steps = (np.arange(n, dtype=np.float32) + 0.5) / n - 0.5
        across = steps / np.float32(lens.fx)
        down = steps / np.float32(lens.fy)
        left = (centre.left[pixels] + across[:, None, None] + np.zeros((1, n, 1), np.float32)).reshape(-1)
        up = (centre.up[pixels] + down[None, :, None] + np.zeros((n, 1, 1), np.float32)).reshape(-1)
        rays = Rays(left.astype(np.float32, copy=False), up.astype(np.float32, copy=False))
        fine = _trace(layers, pose, lens, rays).colours(1 / (n * lens.fx))
        colours[pixels] = fine.reshape(n * n, -1, 3).mean(0)


class _Look(NamedTuple):
    layers: tuple[_Layer, ...]
    light: Light


def _layer(surfaces: Surfaces, known: tuple[_Layer, ...]) -> _Layer:
    """Index surfaces, unless they are indexed already; prepared textures are reused."""
    table = None
    for layer in known:
        if layer.surfaces is surfaces:
            return layer
        if layer.surfaces.textures is surfaces.textures:
            table = layer.shader.table
    return _Layer(surfaces, RayCaster(surfaces.vertices, surfaces.faces), Shader(surfaces, table))


def _trace(layers: tuple[_Layer, ...], pose: Pose, lens: CameraModel, rays: Rays) -> _Seen:
    """Return the first hits of rays in any layer."""
    directions = rays.directions(float(pose[2]), lens)
    origins = np.empty_like(directions)
    origins[:] = (pose[0], pose[1], lens.height_m)
    first, *others = layers
    hits = first.caster.cast(origins, directions)
    depth = np.where(hits.face >= 0, hits.t, np.float32(0))
    met = [_Met(first, 0, slice(None), hits)]
    for number, layer in enumerate(others, 1):
        hits = layer.caster.cast(origins, directions)
        nearer = np.flatnonzero((hits.face >= 0) & ((depth == 0) | (hits.t < depth)))
        if len(nearer):
            depth[nearer] = hits.t[nearer]
            met.append(_Met(layer, number, nearer, hits.take(nearer)))
    return _Seen(directions, depth, tuple(met))


def _lit(colours: NDArray[np.float32], light: Light) -> NDArray[np.float32]:
    if light == PLAIN_LIGHT:
        return colours
    return np.minimum(colours * np.array(light, np.float32), np.float32(255))


def _surface_boundaries(surface: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Mark the pixels (H, W) that show another surface than one of their four neighbours."""
    edges = np.zeros(surface.shape, bool)
    across = surface[:, 1:] != surface[:, :-1]
    down = surface[1:] != surface[:-1]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges
