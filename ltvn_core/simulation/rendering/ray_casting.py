"""The viewing directions of a camera's pixels, and the intersections of rays with triangles.

The only module that imports Embree.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel


class Rays(NamedTuple):
    """Directions (N,) in the camera's frame; the forward component is 1, so that the length along a ray is a depth."""

    left: NDArray[np.float32]
    up: NDArray[np.float32]

    def directions(self, yaw_rad: float, camera: CameraModel) -> NDArray[np.float32]:
        """Return the directions (N, 3) in the world frame, for a camera on a robot with this yaw."""
        rays = self
        if camera.roll_rad or camera.quarter_turns:
            rays = _rolled(rays, replace(camera, pitch_rad=0.0).rotation)
        return _turned(rays, yaw_rad, camera.pitch_rad)


@lru_cache(maxsize=8)
def pixel_rays(camera: CameraModel) -> Rays:
    """Return the viewing directions (H * W) of the pixels, before the camera is rolled and tilted."""
    columns = np.arange(camera.width)
    rows = np.arange(camera.height)
    if camera.distortion or camera.fisheye:
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
        right_down = np.nan_to_num(camera.pixels_to_rays(pixels)).astype(np.float32)
        return Rays(-right_down[:, 0], -right_down[:, 1])
    left = _offsets(columns, camera.cx, camera.fx)
    up = _offsets(rows, camera.cy, camera.fy)
    return Rays(np.tile(left, camera.height), np.repeat(up, camera.width))


def _offsets(pixels: NDArray[np.integer], centre_px: float, focal_px: float) -> NDArray[np.float32]:
    offsets = (centre_px - pixels.astype(np.float32)) / np.float32(focal_px)
    return offsets.astype(np.float32, copy=False)


def _rolled(rays: Rays, rotation: NDArray[np.float64]) -> Rays:
    """Return the rays of a camera that is turned about its axis."""
    turn = rotation.astype(np.float32)
    return Rays(turn[1, 1] * rays.left + turn[1, 2] * rays.up, turn[2, 1] * rays.left + turn[2, 2] * rays.up)


def _turned(rays: Rays, yaw_rad: float, pitch_rad: float) -> NDArray[np.float32]:
    """Return the directions (N, 3) in the world frame.

    Written out per element, because a matrix product would start BLAS threads that cost more than they save here.
    """
    cos = np.float32(np.cos(yaw_rad))
    sin = np.float32(np.sin(yaw_rad))
    rise = np.float32(np.sin(pitch_rad))
    level = np.float32(np.cos(pitch_rad))
    ahead = level - rise * rays.up
    directions = np.empty((len(rays.left), 3), np.float32)
    np.subtract(cos * ahead, sin * rays.left, out=directions[:, 0])
    np.add(sin * ahead, cos * rays.left, out=directions[:, 1])
    np.add(rise, level * rays.up, out=directions[:, 2])
    return directions


class RayHits(NamedTuple):
    """The first intersections of N rays with triangles."""

    face: NDArray[np.int32]
    """(N,) index of the triangle, -1 for none."""
    t: NDArray[np.float32]
    """(N,) distance along the ray in units of its direction vector; undefined without a hit."""
    u: NDArray[np.float32]
    """(N,) barycentric weight of the triangle's second corner."""
    v: NDArray[np.float32]
    """(N,) barycentric weight of the triangle's third corner."""

    def take(self, rays: NDArray[np.intp]) -> "RayHits":
        """Return the intersections of some of the rays (M,)."""
        return RayHits(face=self.face[rays], t=self.t[rays], u=self.u[rays], v=self.v[rays])


class RayCaster:
    """Finds the first triangle along each ray; its cost hardly depends on the number of triangles."""

    def __init__(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> None:
        """Index vertices (V, 3) and faces (F, 3).

        Raises:
            ImportError: Embree is not installed.
        """
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # The scene does not keep its mesh alive, so it is kept here.
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(vertices, np.float32), faces.astype(np.int32))

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> RayHits:
        """Cast rays from origins (N, 3) along directions (N, 3), which need not have unit length."""
        found = self._scene.run(origins, directions, output=True)
        return RayHits(face=found["primID"], t=found["tfar"], u=found["u"], v=found["v"])
