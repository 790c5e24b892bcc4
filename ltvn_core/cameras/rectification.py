"""Rectification: converts an image of any camera to the image of another camera at the same position.

Every pixel is mapped along its ray, so size, focal lengths, centre, distortion, quarter turns, roll and pitch may all
differ, and the image is never stretched. Both cameras have the same height; `rectified_camera` returns the camera of
the result. Owns the maps and the resampling; `ltvn_core.preprocessing` checks the input.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel

_MAX_SAMPLES = 8
"""Largest number of samples along each axis whose mean is a pixel's colour."""

_BORDER_PX = 0.5 + 1e-6
"""Distance from the centres of the outermost pixels to the border of the image, in pixels."""


def rectified_camera(source: CameraModel, target: CameraModel) -> CameraModel:
    """Return the camera of rectified images: the lens and tilt of `target`, at the height of `source`."""
    return replace(target, height_m=source.height_m, depth_scale=1.0)


def have_same_rays(source: CameraModel, target: CameraModel) -> bool:
    """Return whether images of `source` need no rectification for `target`, because both have the same rays at all
    pixels."""
    return replace(source, height_m=0.0, depth_scale=1.0) == replace(target, height_m=0.0, depth_scale=1.0)


def have_same_lens(source: CameraModel, target: CameraModel) -> bool:
    """Return whether two cameras are equal except for their mounting."""
    unmounted = {"pitch_rad": 0.0, "roll_rad": 0.0}
    return have_same_rays(replace(source, **unmounted), replace(target, **unmounted))


class Rectification:
    """Converts images of one camera to images of another. Create it with `rectification`, which caches it."""

    def __init__(self, source: CameraModel, target: CameraModel) -> None:
        """Compute the position of each pixel of `target` in the images of `source`."""
        self.source = source
        self.target = target
        places, self.seen, self._depth_ratio = _source_pixels(source, target, 1)
        """Mask (H, W) of the target's pixels that the source sees; all other pixels are black and have depth 0."""
        self._columns = np.clip(np.rint(places[..., 0]), 0, source.width - 1).astype(np.intp)
        self._rows = np.clip(np.rint(places[..., 1]), 0, source.height - 1).astype(np.intp)
        self._samples = _samples_per_axis(source, target)
        fine, fine_seen, _ = _source_pixels(source, target, self._samples)
        # At the border, a part of a visible pixel may be out of view; that part gets the colour of the pixel's centre.
        middles = places.repeat(self._samples, axis=0).repeat(self._samples, axis=1)
        fine = np.where(fine_seen[..., None], fine, middles)
        border = np.array([source.width - 1, source.height - 1])
        self._fine = np.clip(fine, 0, border).astype(np.float32)

    def rectify_rgb(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return colours (H, W, 3) of the target from those of the source; black where the source sees nothing."""
        import cv2  # Importing takes 0.1 s, so it is done only for cameras that need rectification.

        n = self._samples
        fine = cv2.remap(np.ascontiguousarray(rgb), self._fine[..., 0], self._fine[..., 1], cv2.INTER_LINEAR)
        size = (self.target.width, self.target.height)
        image = np.asarray(fine if n == 1 else cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.uint8)
        image[~self.seen] = 0
        return image

    def rectify_depth(self, depth_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return depth (H, W) along the target's axis from depth along the source's axis, in metres; 0 if out of view.

        The nearest pixel is used, because a mean across a depth edge would be a point in free space.
        """
        depth = depth_m[self._rows, self._columns] * self._depth_ratio
        return np.where(self.seen, depth, 0).astype(np.float32)


@lru_cache(maxsize=8)
def rectification(source: CameraModel, target: CameraModel) -> Rectification:
    """Return the rectification from one camera to another; its maps are cached."""
    return Rectification(source, target)


def _source_pixels(
    source: CameraModel, target: CameraModel, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float32]]:
    """Map the pixels of the target along their rays to the source.

    Returns their positions in the source's image (H * samples, W * samples, 2), whether the source sees them, and the
    depth along the target's axis for each metre along the source's axis.
    """
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    columns = (np.arange(target.width)[:, None] + inner).ravel()
    rows = (np.arange(target.height)[:, None] + inner).ravel()
    right_down = target.pixels_to_rays(np.stack(np.meshgrid(columns, rows), axis=-1))
    rays = np.concatenate([np.ones((*right_down.shape[:2], 1)), -right_down], axis=-1)
    # From the target's frame to the robot's, then to the source's; both matrices act on row vectors.
    rays = rays @ (target.rotation.T @ source.rotation)
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(rays[..., 0] > 1e-6, rays[..., 0], np.nan)
        ideal = np.stack([-rays[..., 1] / ahead, -rays[..., 2] / ahead], axis=-1)
        pixels = source.rays_to_pixels(ideal)
        within = np.abs(pixels - _middle(source)) <= _middle(source) + _BORDER_PX
        seen: NDArray[np.bool_] = np.logical_and(within[..., 0], within[..., 1])
    return np.where(seen[..., None], pixels, 0.0), seen, np.where(seen, 1 / ahead, 0).astype(np.float32)


def _middle(camera: CameraModel) -> NDArray[Any]:
    return np.array([(camera.width - 1) / 2, (camera.height - 1) / 2])


def _samples_per_axis(source: CameraModel, target: CameraModel) -> int:
    """Return the number of samples along each axis that is needed to cover all source pixels within one target
    pixel."""
    pixels = max(source.fx, source.fy) / min(target.fx, target.fy)
    return min(max(math.ceil(pixels - 1e-6), 1), _MAX_SAMPLES)
