"""A bare room whose walls, floor and ceiling carry patterns without repetition, seen by any camera, exact."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Depth, Observation, Pose, Rgb

CAMERA = CameraModel.from_fov(320, 240, np.deg2rad(69.4), height_m=0.6)
SIZE_M = np.array([5.0, 4.0, 2.4])
_PIXELS_PER_M = 90


class TexturedRoom:
    """Casts one ray per pixel. The floor spans (0, 0) to (5, 4) m."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._faces = [_pattern(rng) for _ in range(6)]

    def render(self, pose: Pose, camera: CameraModel = CAMERA) -> tuple[Rgb, Depth]:
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        right_down = camera.pixels_to_rays(np.stack([columns, rows], axis=-1).astype(float))
        rays = np.concatenate([np.ones((*right_down.shape[:2], 1)), -right_down], axis=-1) @ camera.rotation.T
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        rays = rays @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T
        eye = np.array([pose[0], pose[1], camera.height_m])
        walls = np.where(rays > 0, SIZE_M, 0.0)
        with np.errstate(divide="ignore"):
            reach = (walls - eye) / np.where(rays == 0, 1e-9, rays)
        axis = reach.argmin(-1)
        depth = reach.min(-1)
        return self._colours(eye + rays * depth[..., None], axis, rays), depth.astype(np.float32)

    def observe(self, pose: Pose, step: int = 0, camera: CameraModel = CAMERA) -> Observation:
        pose = np.asarray(pose, np.float64)
        rgb, depth = self.render(pose, camera)
        return Observation(rgb=rgb, depth=depth, odometry=pose, stamp=float(step), step=step)

    def _colours(self, places: NDArray[np.float64], axis: NDArray[np.intp], rays: NDArray[np.float64]) -> Rgb:
        image = np.zeros((*axis.shape, 3), np.uint8)
        for face in range(6):
            side, positive = face % 3, face >= 3
            on_it = (axis == side) & ((np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0) == positive)
            across, up = [k for k in range(3) if k != side]
            places_px = (places[..., [across, up]] * _PIXELS_PER_M).astype(np.float32)
            seen = cv2.remap(self._faces[face], places_px[..., 0], places_px[..., 1], cv2.INTER_LINEAR)
            image[on_it] = seen[on_it]
        return image


def without_depth(observation: Observation) -> Observation:
    """Return the image of a camera that has no depth."""
    return replace(observation, depth=None)


def _pattern(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Draw patches of several sizes."""
    size = int(5.2 * _PIXELS_PER_M)
    coarse = [cv2.resize(rng.random((size // n, size // n, 3)), (size, size)) for n in (8, 20, 60)]
    return np.clip(255 * (0.5 + 0.9 * (np.mean(coarse, axis=0) - 0.5) * 2), 0, 255).astype(np.uint8)
