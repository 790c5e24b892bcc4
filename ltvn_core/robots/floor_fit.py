"""How a camera seems to be tilted and how high it is, from the floor in its depth image. Owns the fit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Depth

_NEAR_FLOOR_M, _NEAR_FLOOR_SLOPE = 0.06, 0.08
"""What is so near to the floor as the profile has it may be floor, and the more the farther ahead it is; the seat of a
sofa is not."""
_ON_PLANE_M = 0.02
_TRIES = 300
"""So many planes through three points are tried; the one with most points on it is the floor."""
_STEEPEST = 0.3
"""No floor rises more than this, as a slope."""
_LEAST_EXTENT_M = 0.9
"""Of nine tenths of the floor, ahead and across: a strip before a wall and the foot of the wall lie on a plane, too."""
_FAR_M = 3.5
"""Depth cameras are too inaccurate beyond."""
_FEWEST_POINTS = 100
_MOSTLY = 0.65
"""So much of what is near the floor must be floor, or it is the foot of a wall, or furniture."""


@dataclass(frozen=True, slots=True)
class FloorFit:
    """What the floor says against a profile."""

    pitch_off_deg: float
    """The camera looks so much higher than its profile says."""
    roll_off_deg: float
    """Its right side is so much lower than its profile says."""
    height_off_m: float
    """It stands so much higher than its profile says."""


def fit_floor(depth: Depth, camera: CameraModel) -> FloorFit | None:
    """Return how far a camera at its place on the robot is off; None where too little floor is seen."""
    points = camera.unproject_image(np.where(depth < _FAR_M, depth, 0))
    near = points[np.abs(points[:, 2]) < _NEAR_FLOOR_M + _NEAR_FLOOR_SLOPE * points[:, 0]]
    if len(near) < _FEWEST_POINTS:
        return None
    floor = near[_most_on_a_plane(near)]
    if len(floor) < max(_FEWEST_POINTS, _MOSTLY * len(near)) or _extent(floor) < _LEAST_EXTENT_M:
        return None
    ahead, left, up_m = np.linalg.lstsq(_columns(floor), floor[:, 2], rcond=None)[0]
    return FloorFit(
        pitch_off_deg=-float(np.degrees(np.arctan(ahead))),
        roll_off_deg=-float(np.degrees(np.arctan(left))),
        height_off_m=-float(up_m),
    )


def _extent(floor: NDArray[np.float64]) -> float:
    low, high = np.percentile(floor[:, :2], (5, 95), axis=0)
    return float((high - low).min())


def _most_on_a_plane(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points (N, 3) lie on the plane that most of them lie on; none where every plane is steep."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))]
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(along, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = -normals[:, :2] / normals[:, 2:]
    usable = np.isfinite(slopes).all(axis=1) & (np.abs(slopes).max(axis=1) < _STEEPEST)
    if not usable.any():
        return np.zeros(len(points), bool)
    slopes, corners = slopes[usable], corners[usable, 0]
    begin = corners[:, 2] - (slopes * corners[:, :2]).sum(axis=1)
    on_plane = np.abs(points[:, 2] - slopes @ points[:, :2].T - begin[:, None]) < _ON_PLANE_M
    return on_plane[np.argmax(on_plane.sum(axis=1))]


def _columns(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([points[:, :2], np.ones(len(points))])
