"""Where a predicted waypoint lies in the picture it was predicted from.

Owns the projection alone. Pixels count from the picture's left upper corner; the first one's centre is (0.5, 0.5).
"""

from typing import NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Waypoint

_NEAREST_M = 0.05
"""What is less far ahead of the lens has no picture."""


class Pixel(NamedTuple):
    """A place in a picture, in pixels; not rounded."""

    u: float
    """To the right."""
    v: float
    """Down."""


def pole_in_image(waypoint: Waypoint, camera: CameraModel) -> tuple[Pixel, Pixel] | None:
    """Return both ends of a pole as high as the camera that stands at a waypoint (3,), top first, cut at the border.

    None if it stands aside or behind; an edge that is driven backwards is better drawn into its target's picture.
    """
    top, foot = (_projected(waypoint, camera, height) for height in (camera.height_m, 0.0))
    if top is None or foot is None:
        return None
    ends = np.array([top, foot])
    begin = 0.0
    end = 1.0
    for start, stop, size in zip(ends[0], ends[1], (camera.width, camera.height), strict=True):
        slope = stop - start
        if abs(slope) < 1e-9:
            begin, end = (begin, end) if 0 <= start <= size else (1.0, 0.0)
            continue
        first, last = sorted(((0 - start) / slope, (size - start) / slope))
        begin = max(begin, first)
        end = min(end, last)
    if begin > end:
        return None
    cut = [ends[0] + share * (ends[1] - ends[0]) for share in (begin, end)]
    return Pixel(*map(float, cut[0])), Pixel(*map(float, cut[1]))


def _projected(waypoint: Waypoint, camera: CameraModel, height_m: float) -> Pixel | None:
    """Project a point on the plane of the picture, which has no border here; None behind the lens."""
    point = np.array([waypoint[0], waypoint[1], height_m], np.float64)
    if float((point - [0.0, 0.0, camera.height_m]) @ camera.rotation[:, 0]) < _NEAREST_M:
        return None
    u, v = camera.project(point) + 0.5
    return Pixel(float(u), float(v))
