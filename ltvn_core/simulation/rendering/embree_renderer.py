"""The RGB-D renderer by ray casting with Embree, with antialiasing.

Knows surfaces, but neither rooms nor robots.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.simulation.light import PLAIN_LIGHT, Light
from ltvn_core.simulation.rendering.camera_rays import Rays, pixel_rays
from ltvn_core.simulation.rendering.ray_casting import RayCaster, RayHits
from ltvn_core.simulation.rendering.shading import Shader
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Depth, Pose, Rgb

MAX_DEPTH_M = 10.0
"""Range of the depth camera; depth is 0 beyond it."""
_SURFACES_PER_LAYER = 1 << 26
"""Numbers of surfaces of different layers differ by this much."""


class VisibleScene(Protocol):
    """What a camera sees of a scene at one moment."""

    @property
    def surfaces(self) -> Surfaces:
        """What belongs to the scene."""
        ...

    @property
    def added(self) -> tuple[Surfaces, ...]:
        """What stands in it for now."""
        ...

    @property
    def light(self) -> Light:
        """How it is lit."""
        ...


class _Layer(NamedTuple):
    """Surfaces, ready for rays. A scene has one; what is added to it for now has its own, because these are few."""

    surfaces: Surfaces
    caster: RayCaster
    shader: Shader


class _Met(NamedTuple):
    """What some of N rays meet in one layer."""

    layer: _Layer
    number: int
    """Of the layer."""
    rays: NDArray[np.intp] | slice
    """Which rays."""
    hits: RayHits


class _Seen(NamedTuple):
    """What N rays meet. Their colours cost more than all the rest, so they are computed for those who ask."""

    directions: NDArray[np.float32]
    """(N, 3)"""
    depth: NDArray[np.float32]
    """(N,) metres along the optical axis, 0 where they meet nothing."""
    met: tuple[_Met, ...]
    """In the first layer all rays; later ones lie before those before."""

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
    """Casts a ray through every pixel's centre, and `supersampling` squared more where surfaces meet."""

    name = "Embree"

    def __init__(self, surfaces: Surfaces, *, supersampling: int = 2) -> None:
        """Index the surfaces.

        Args:
            surfaces: What is rendered.
            supersampling: Rays per side of a pixel where surfaces meet; 1 leaves edges jagged.

        Raises:
            ImportError: Embree is not installed.
        """
        self._look = _Look((_layer(surfaces, ()),), PLAIN_LIGHT)
        self._supersampling = supersampling

    def show(self, scene: VisibleScene) -> None:
        """Render another state of the scene from now on; only what differs is indexed anew. Any thread may call it."""
        known = self._look.layers
        layers = tuple(_layer(surfaces, known) for surfaces in (scene.surfaces, *scene.added))
        self._look = _Look(layers, scene.light)

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) and depth (H, W) in metres along the optical axis, 0 beyond 10 m."""
        colours, depth = self.measure(pose, camera)
        return colours(), depth

    def measure(self, pose: Pose, camera: CameraModel) -> tuple[Callable[[], Rgb], Depth]:
        """Return the same depth, and what renders the same rgb, now or later: the scene as it is now."""
        look = self._look  # Another thread may show another state meanwhile.
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
        across, down = steps / np.float32(lens.fx), steps / np.float32(lens.fy)
        left = (centre.left[pixels] + across[:, None, None] + np.zeros((1, n, 1), np.float32)).reshape(-1)
        up = (centre.up[pixels] + down[None, :, None] + np.zeros((n, 1, 1), np.float32)).reshape(-1)
        rays = Rays(left.astype(np.float32, copy=False), up.astype(np.float32, copy=False))
        fine = _trace(layers, pose, lens, rays).colours(1 / (n * lens.fx))
        colours[pixels] = fine.reshape(n * n, -1, 3).mean(0)


class _Look(NamedTuple):
    layers: tuple[_Layer, ...]
    light: Light


def _layer(surfaces: Surfaces, known: tuple[_Layer, ...]) -> _Layer:
    """Index surfaces, unless that was done before; textures that were prepared before are taken over."""
    table = None
    for layer in known:
        if layer.surfaces is surfaces:
            return layer
        if layer.surfaces.textures is surfaces.textures:
            table = layer.shader.table
    return _Layer(surfaces, RayCaster(surfaces.vertices, surfaces.faces), Shader(surfaces, table))


def _trace(layers: tuple[_Layer, ...], pose: Pose, lens: CameraModel, rays: Rays) -> _Seen:
    """Return what rays meet first in any layer."""
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
    across, down = surface[:, 1:] != surface[:, :-1], surface[1:] != surface[:-1]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges
