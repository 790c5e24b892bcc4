"""The RGB-D renderer by ray casting with Embree, with antialiasing.

Knows surfaces, but neither rooms nor robots.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.simulation.rendering.ray_casting import RayCaster, RayHits
from ltvn_core.simulation.rendering.shading import Shader
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Depth, Pose, Rgb

MAX_DEPTH_M = 10.0
"""Range of the depth camera; depth is 0 beyond it."""


class _Rays(NamedTuple):
    """Directions (N,) in the camera's frame; the forward component is 1, so that the length along a ray is a depth."""

    left: NDArray[np.float32]
    up: NDArray[np.float32]


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
        self._caster = RayCaster(surfaces.vertices, surfaces.faces)
        self._shader = Shader(surfaces)
        self._supersampling = supersampling

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) and depth (H, W) in metres along the optical axis, 0 beyond 10 m."""
        rays = _pixel_rays(camera)
        hits, colours = self._trace(pose, camera, rays, 1 / camera.fx)
        if self._supersampling > 1:
            surface = self._shader.surface_of(hits.face).reshape(camera.height, camera.width)
            self._antialias(colours, np.flatnonzero(_surface_boundaries(surface)), pose, camera)
        shape = (camera.height, camera.width)
        rgb = np.rint(colours).astype(np.uint8).reshape(*shape, 3)
        return rgb, np.where((hits.face >= 0) & (hits.t <= MAX_DEPTH_M), hits.t, np.float32(0)).reshape(shape)

    def _antialias(self, colours: NDArray[np.float32], pixels: NDArray[np.intp], pose: Pose, lens: CameraModel) -> None:
        """Replace the colours of `pixels` by the mean over a regular grid of rays within each."""
        centre = _pixel_rays(lens)
        n = self._supersampling
        steps = (np.arange(n, dtype=np.float32) + 0.5) / n - 0.5
        across, down = steps / np.float32(lens.fx), steps / np.float32(lens.fy)
        left = (centre.left[pixels] + across[:, None, None] + np.zeros((1, n, 1), np.float32)).reshape(-1)
        up = (centre.up[pixels] + down[None, :, None] + np.zeros((n, 1, 1), np.float32)).reshape(-1)
        rays = _Rays(left.astype(np.float32, copy=False), up.astype(np.float32, copy=False))
        _, fine = self._trace(pose, lens, rays, 1 / (n * lens.fx))
        colours[pixels] = fine.reshape(n * n, -1, 3).mean(0)

    def _trace(self, pose: Pose, lens: CameraModel, rays: _Rays, spread: float) -> tuple[RayHits, NDArray[np.float32]]:
        if lens.roll_rad or lens.quarter_turns:
            rays = _rolled(rays, replace(lens, pitch_rad=0.0).rotation)
        directions = _turned(rays, float(pose[2]), lens.pitch_rad)
        origins = np.empty_like(directions)
        origins[:] = (pose[0], pose[1], lens.height_m)
        hits = self._caster.cast(origins, directions)
        return hits, self._shader.colours(hits, directions, spread)


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
