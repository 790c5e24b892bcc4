"""Where a predicted waypoint lies in the picture it was predicted from.

Owns the projection alone. Pixels count from the picture's left upper corner; the first one's centre is (0.5, 0.5).
"""

from typing import NamedTuple

import numpy as np

from ltvn_core.types import Intrinsics, Waypoint

_NEAREST_M = 0.05
"""What is less far ahead of the lens has no picture."""


class Pixel(NamedTuple):
    """A place in a picture, in pixels; not rounded."""

    u: float
    """To the right."""
    v: float
    """Down."""


def pole_in_image(waypoint: Waypoint, intrinsics: Intrinsics) -> tuple[Pixel, Pixel] | None:
    """Return both ends of a pole as high as the camera that stands at a waypoint (3,), top first, cut at the border.

    None if it stands aside or behind; an edge that is driven backwards is better drawn into its target's picture.
    """
    top, foot = (_projected(waypoint, intrinsics, height) for height in (intrinsics.height_m, 0.0))
    if top is None or foot is None:
        return None
    ends = np.array([top, foot])
    begin, end = 0.0, 1.0
    for start, stop, size in zip(ends[0], ends[1], (intrinsics.width, intrinsics.height), strict=True):
        slope = stop - start
        if abs(slope) < 1e-9:
            begin, end = (begin, end) if 0 <= start <= size else (1.0, 0.0)
            continue
        first, last = sorted(((0 - start) / slope, (size - start) / slope))
        begin, end = max(begin, first), min(end, last)
    if begin > end:
        return None
    cut = [ends[0] + share * (ends[1] - ends[0]) for share in (begin, end)]
    return Pixel(*map(float, cut[0])), Pixel(*map(float, cut[1]))


def _projected(waypoint: Waypoint, intrinsics: Intrinsics, height_m: float) -> Pixel | None:
    """Project a point on the plane of the picture, which has no border here; None behind the lens."""
    ahead, left, rise = float(waypoint[0]), float(waypoint[1]), height_m - intrinsics.height_m
    cos, sin = np.cos(intrinsics.pitch_rad), np.sin(intrinsics.pitch_rad)
    depth, up = cos * ahead + sin * rise, cos * rise - sin * ahead
    if depth < _NEAREST_M:
        return None
    scale = intrinsics.focal_px / depth
    return Pixel(float(intrinsics.width / 2 - scale * left), float(intrinsics.height / 2 - scale * up))
