"""Depth as another camera on the same robot would have seen it: from a depth camera to the colours beside it."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.importing.moving_frame import Transform
from ltvn_core.types import Depth

_NEAREST_M = 0.01
"""What is nearer than a centimetre to the lens is no depth."""


def register_depth(
    depth_m: Depth, depth_camera: CameraModel, colour_camera: CameraModel, colour_from_depth: Transform
) -> Depth:
    """Return the depth that the colour camera would have seen, 0 where nothing was measured.

    The result shows all that the colours show, at no more pixels than the depth has, so that it has no gaps between
    neighbouring points. Of several points in a pixel the nearest counts.

    Args:
        depth_m: (h, w) metres along the depth camera's axis.
        depth_camera: The lens and size of `depth_m`.
        colour_camera: The lens and size of the colours.
        colour_from_depth: (4, 4), takes points of the depth camera's optical frame to the colour camera's.
    """
    target = _coarse_enough(colour_camera, depth_camera)
    rows, columns = np.nonzero(depth_m > 0)
    metres = depth_m[rows, columns].astype(np.float64)
    rays = _rays(depth_camera)[rows, columns]
    points = np.column_stack([rays * metres[:, None], metres]) @ colour_from_depth[:3, :3].T + colour_from_depth[:3, 3]
    points = points[points[:, 2] > _NEAREST_M]
    pixels = target.rays_to_pixels(points[:, :2] / points[:, 2:])
    known = np.isfinite(pixels).all(axis=1)
    column, row = np.rint(pixels[known].clip(-1, 2**20)).astype(np.int64).T
    inside = (column >= 0) & (column < target.width) & (row >= 0) & (row < target.height)
    nearest = np.full(target.width * target.height, np.inf)
    np.minimum.at(nearest, row[inside] * target.width + column[inside], points[known][inside, 2])
    return np.where(np.isfinite(nearest), nearest, 0).astype(np.float32).reshape(target.height, target.width)


@lru_cache(maxsize=4)
def _coarse_enough(colour: CameraModel, depth: CameraModel) -> CameraModel:
    scale = min(1.0, depth.fx / colour.fx, depth.fy / colour.fy)
    return colour.scaled(max(round(colour.width * scale), 1), max(round(colour.height * scale), 1))


@lru_cache(maxsize=4)
def _rays(camera: CameraModel) -> NDArray[np.float64]:
    """Return right and down of each pixel (h, w, 2) at one metre of depth."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return camera.pixels_to_rays(np.stack([columns, rows], axis=-1).astype(np.float64))
