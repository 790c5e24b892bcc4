"""An orthographic image of a scene from above, with a constant scale."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.simulation.rendering.embree_renderer import Shader
from ltvn_core.simulation.rendering.ray_casting import RayCaster
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Rgb

_ROWS_AT_ONCE = 128
_ABOVE_M = 1.0


def floor_picture(surfaces: Surfaces, low: ArrayLike, high: ArrayLike, *, most_px: int) -> Rgb:
    """Return the image from above (H, W, 3): x to the right, y up.

    Args:
        surfaces: The scene, without its ceiling.
        low: (2,) corner of the image with the least x and y, in metres.
        high: (2,) corner of the image with the largest x and y, in metres.
        most_px: Length of the image's longer side in pixels.

    Raises:
        ImportError: Embree is not installed.
    """
    low_m = np.asarray(low, np.float64)
    size_m = np.asarray(high, np.float64) - low_m
    pixel_m = float(size_m.max()) / most_px
    width = max(round(size_m[0] / pixel_m), 1)
    height = max(round(size_m[1] / pixel_m), 1)
    x = low_m[0] + (np.arange(width) + 0.5) * pixel_m
    y = low_m[1] + (np.arange(height)[::-1] + 0.5) * pixel_m
    caster = RayCaster(surfaces.vertices, surfaces.faces)
    shader = Shader(surfaces)
    top_m = float(surfaces.vertices[:, 2].max()) + _ABOVE_M
    # A few rows at a time, because the hits of all rays together take gigabytes.
    rows = [
        _seen(caster, shader, x, y[first : first + _ROWS_AT_ONCE], top_m, pixel_m)
        for first in range(0, height, _ROWS_AT_ONCE)
    ]
    return np.concatenate(rows)


def _seen(
    caster: RayCaster,
    shader: Shader,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    top_m: float,
    pixel_m: float,
) -> Rgb:
    origins = np.empty((len(y), len(x), 3), np.float32)
    origins[..., 0] = x
    origins[..., 1] = y[:, None]
    origins[..., 2] = top_m
    directions = np.zeros((origins.shape[0] * origins.shape[1], 3), np.float32)
    directions[:, 2] = -1
    hits = caster.cast(origins.reshape(-1, 3), directions)
    # All rays are parallel, so a sample has the same width at any distance.
    colours = shader.colours(hits._replace(t=np.ones_like(hits.t)), directions, pixel_m)
    return np.rint(colours).clip(0, 255).astype(np.uint8).reshape(len(y), len(x), 3)
