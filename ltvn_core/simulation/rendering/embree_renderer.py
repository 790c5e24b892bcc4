"""The RGB-D renderer by ray casting with Embree, with antialiasing.

Knows surfaces, but neither rooms nor robots.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.simulation.light import PLAIN_LIGHT, Light
from ltvn_core.simulation.rendering.ray_casting import RayCaster, RayHits
from ltvn_core.simulation.rendering.shading import Shader
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Depth, Pose, Rgb

MAX_DEPTH_M = 10.0
"""Range of the depth camera; depth is 0 beyond it."""
_SURFACES_PER_LAYER = 1 << 26
"""Numbers of surfaces of different layers differ by this much."""


class _Rays(NamedTuple):
    """Directions (N,) in the camera's frame; the forward component is 1, so that the length along a ray is a depth."""

    left: NDArray[np.float32]
    up: NDArray[np.float32]


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


class _Seen(NamedTuple):
    """What N rays meet."""

    depth: NDArray[np.float32]
    """(N,) metres along the optical axis, 0 where they meet nothing."""
    surface: NDArray[np.int32]
    """(N,) number of the surface."""
    colours: NDArray[np.float32]
    """(N, 3) in [0, 255]."""


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
        look = self._look  # Another thread may show another state meanwhile.
        shape = (camera.height, camera.width)
        seen = _trace(look.layers, pose, camera, _pixel_rays(camera), 1 / camera.fx)
        colours = seen.colours
        if self._supersampling > 1:
            boundaries = _surface_boundaries(seen.surface.reshape(shape))
            self._antialias(look.layers, colours, np.flatnonzero(boundaries), pose, camera)
        rgb = np.rint(_lit(colours, look.light)).astype(np.uint8).reshape(*shape, 3)
        return rgb, np.where(seen.depth <= MAX_DEPTH_M, seen.depth, np.float32(0)).reshape(shape)

    def _antialias(
        self,
        layers: tuple[_Layer, ...],
        colours: NDArray[np.float32],
        pixels: NDArray[np.intp],
        pose: Pose,
        lens: CameraModel,
    ) -> None:
        """Replace the colours of `pixels` by the mean over a regular grid of rays within each."""
        centre = _pixel_rays(lens)
        n = self._supersampling
        steps = (np.arange(n, dtype=np.float32) + 0.5) / n - 0.5
        across, down = steps / np.float32(lens.fx), steps / np.float32(lens.fy)
        left = (centre.left[pixels] + across[:, None, None] + np.zeros((1, n, 1), np.float32)).reshape(-1)
        up = (centre.up[pixels] + down[None, :, None] + np.zeros((n, 1, 1), np.float32)).reshape(-1)
        rays = _Rays(left.astype(np.float32, copy=False), up.astype(np.float32, copy=False))
        fine = _trace(layers, pose, lens, rays, 1 / (n * lens.fx)).colours
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


def _trace(layers: tuple[_Layer, ...], pose: Pose, lens: CameraModel, rays: _Rays, spread: float) -> _Seen:
    """Return what rays meet first in any layer."""
    if lens.roll_rad or lens.quarter_turns:
        rays = _rolled(rays, replace(lens, pitch_rad=0.0).rotation)
    directions = _turned(rays, float(pose[2]), lens.pitch_rad)
    origins = np.empty_like(directions)
    origins[:] = (pose[0], pose[1], lens.height_m)
    first, *others = layers
    hits = first.caster.cast(origins, directions)
    depth = np.where(hits.face >= 0, hits.t, np.float32(0))
    surface = first.shader.surface_of(hits.face)
    colours = first.shader.colours(hits, directions, spread)
    for number, layer in enumerate(others, 1):
        hits = layer.caster.cast(origins, directions)
        nearer = np.flatnonzero((hits.face >= 0) & ((depth == 0) | (hits.t < depth)))
        if not len(nearer):
            continue
        met = RayHits(face=hits.face[nearer], t=hits.t[nearer], u=hits.u[nearer], v=hits.v[nearer])
        depth[nearer] = met.t
        surface[nearer] = layer.shader.surface_of(met.face) + number * _SURFACES_PER_LAYER
        colours[nearer] = layer.shader.colours(met, directions[nearer], spread)
    return _Seen(depth, surface, colours)


def _lit(colours: NDArray[np.float32], light: Light) -> NDArray[np.float32]:
    if light == PLAIN_LIGHT:
        return colours
    return np.minimum(colours * np.array(light, np.float32), np.float32(255))


@lru_cache(maxsize=8)
def _pixel_rays(camera: CameraModel) -> _Rays:
    """Return where the pixels (H * W) look before the camera is rolled and tilted."""
    columns, rows = np.arange(camera.width), np.arange(camera.height)
    if camera.distortion or camera.fisheye:
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        right_down = np.nan_to_num(camera.pixels_to_rays(pixels)).astype(np.float32)
        return _Rays(-right_down[:, 0], -right_down[:, 1])
    left, up = _offsets(columns, camera.cx, camera.fx), _offsets(rows, camera.cy, camera.fy)
    return _Rays(np.tile(left, camera.height), np.repeat(up, camera.width))


def _offsets(pixels: NDArray[np.integer], centre_px: float, focal_px: float) -> NDArray[np.float32]:
    offsets = (centre_px - pixels.astype(np.float32)) / np.float32(focal_px)
    return offsets.astype(np.float32, copy=False)


def _rolled(rays: _Rays, rotation: NDArray[np.float64]) -> _Rays:
    """Return the rays of a camera that is turned about its axis."""
    turn = rotation.astype(np.float32)
    return _Rays(turn[1, 1] * rays.left + turn[1, 2] * rays.up, turn[2, 1] * rays.left + turn[2, 2] * rays.up)


def _turned(rays: _Rays, yaw_rad: float, pitch_rad: float) -> NDArray[np.float32]:
    """Return the directions (N, 3) in the world frame.

    Written out per element, because a matrix product would start BLAS threads that cost more than they save here.
    """
    cos, sin = np.float32(np.cos(yaw_rad)), np.float32(np.sin(yaw_rad))
    rise, level = np.float32(np.sin(pitch_rad)), np.float32(np.cos(pitch_rad))
    ahead = level - rise * rays.up
    directions = np.empty((len(rays.left), 3), np.float32)
    np.subtract(cos * ahead, sin * rays.left, out=directions[:, 0])
    np.add(sin * ahead, cos * rays.left, out=directions[:, 1])
    np.add(rise, level * rays.up, out=directions[:, 2])
    return directions


def _surface_boundaries(surface: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Mark the pixels (H, W) that show another surface than one of their four neighbours."""
    edges = np.zeros(surface.shape, bool)
    across, down = surface[:, 1:] != surface[:, :-1], surface[1:] != surface[:-1]
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges
