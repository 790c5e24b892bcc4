"""Motion of a camera between two images, from key points alone.

Owns the tracking and the model of the motion. A turn shifts all points by the same angle; driving moves them away from
the middle. Both are fitted together, so that a near wall on one side does not look like a turn.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Observation, Pose

_WIDTH_PX = 160
_POINTS = 100
_FEWEST_POINTS = 20
_FEWEST_SHARE = 0.5
"""Least number of tracked points, and least share of the points that must be tracked, to know a motion."""
_BACK_PX = 1.0
"""Largest distance in pixels between a point and itself after tracking forwards and backwards."""
_AGREEING_SHARE = 0.6
"""Least share of the tracked points that must move as one scene; people who pass cover fewer."""
_AGREEING_PX = 2.0
_AGREEING_RAD = np.radians(1.5)
_ROUNDS = 6
_STEEPEST_COS = 0.4
"""Least cosine of a ray's elevation; steeper rays have no useful azimuth."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A small grey image, with the time, the pose and the camera to which it belongs."""

    stamp: float
    pose: Pose
    grey: NDArray[np.uint8]
    camera: CameraModel
    """Camera at the size of `grey`, with its tilt at that moment."""

    @classmethod
    def of(cls, seen: Observation, camera: CameraModel) -> Self:
        """Return the view of an observation, taken by the recorded `camera`."""
        height, width = seen.rgb.shape[:2]
        size = (_WIDTH_PX, max(round(height * _WIDTH_PX / width), 1))
        grey = cv2.resize(cv2.cvtColor(seen.rgb, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
        if seen.tilt is not None:
            camera = replace(camera, pitch_rad=seen.tilt.pitch_rad, roll_rad=seen.tilt.roll_rad)
        return cls(seen.stamp, seen.odometry, np.asarray(grey, np.uint8), camera.scaled(*size))


@dataclass(frozen=True, slots=True)
class ImageMotion:
    """Motion between two images."""

    shift: float
    """Median shift of the points, as a share of the image's width."""
    turn_rad: float | None
    """Turn of the camera, counter-clockwise positive; None if the points do not agree about it."""
    is_one_scene: bool
    """Whether most points moved together, so that the camera moved and not something before it."""


def image_motion(before: View, now: View) -> ImageMotion | None:
    """Return the motion from one view to the next; None if too few points are seen in both."""
    if before.grey.shape != now.grey.shape:
        return None
    corners = cv2.goodFeaturesToTrack(before.grey, _POINTS, 0.01, 5)
    if corners is None or len(corners) < _FEWEST_POINTS:
        return None
    points = np.asarray(corners, np.float32)
    pair = _tracked(before.grey, now.grey, points, points)
    if pair is None:  # A turn of many degrees; both images as a whole tell about where the points went.
        whole = before.grey.astype(np.float32), now.grey.astype(np.float32)
        shift, _ = cv2.phaseCorrelate(whole[0], whole[1], _window_of(*before.grey.shape))
        pair = _tracked(before.grey, now.grey, points, points + np.array(shift, np.float32))
    if pair is None:
        return None
    start, end = pair
    _, inside = cv2.estimateAffine2D(start, end, ransacReprojThreshold=_AGREEING_PX)
    return ImageMotion(
        shift=float(np.median(np.linalg.norm(end - start, axis=1))) / _WIDTH_PX,
        turn_rad=_turn_rad(_rays(start, before.camera), _rays(end, now.camera)),
        is_one_scene=inside is not None and float(inside.mean()) >= _AGREEING_SHARE,
    )


def _tracked(
    before: NDArray[np.uint8], now: NDArray[np.uint8], points: NDArray[np.float32], guess: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return where points (N, 1, 2) were and where they are now, (M, 2) each; None if too few are found again."""
    flag = cv2.OPTFLOW_USE_INITIAL_FLOW
    found, ahead, _ = cv2.calcOpticalFlowPyrLK(before, now, points, guess.copy(), flags=flag)
    again, back, _ = cv2.calcOpticalFlowPyrLK(now, before, found, found - (guess - points), flags=flag)
    is_back = np.linalg.norm((again - points).reshape(-1, 2), axis=1) < _BACK_PX
    good = (ahead.ravel() == 1) & (back.ravel() == 1) & is_back
    if good.sum() < max(_FEWEST_POINTS, _FEWEST_SHARE * len(points)):
        return None
    return points.reshape(-1, 2)[good].astype(np.float64), found.reshape(-1, 2)[good].astype(np.float64)


@lru_cache(maxsize=2)
def _window_of(height: int, width: int) -> NDArray[np.float32]:
    return np.asarray(cv2.createHanningWindow((width, height), cv2.CV_32F), np.float32)


def _rays(pixels: NDArray[np.float64], camera: CameraModel) -> NDArray[np.float64]:
    """Return the directions (N, 3) of pixels in a level frame: forward, left, up."""
    right_down = camera.pixels_to_rays(pixels)
    rays = np.column_stack([np.ones(len(pixels)), -right_down]) @ camera.rotation.T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _turn_rad(start: NDArray[np.float64], end: NDArray[np.float64]) -> float | None:
    """Return the turn that takes the directions `start` (N, 3) to `end`; None if too few agree."""
    level = np.minimum(np.hypot(*start[:, :2].T), np.hypot(*end[:, :2].T)) > _STEEPEST_COS
    before, after = (np.arctan2(rays[level, 1], rays[level, 0]) for rays in (start, end))
    if len(before) < _FEWEST_POINTS:
        return None
    change = np.angle(np.exp(1j * (after - before)))
    model = np.column_stack([np.ones(len(before)), np.sin(before)])
    fit = np.array([np.median(change), 0.0])
    for _ in range(_ROUNDS):
        weights = np.sqrt(1 / np.maximum(np.abs(change - model @ fit), 1e-3))
        fit = np.linalg.lstsq(model * weights[:, None], change * weights, rcond=None)[0]
    agreeing = np.abs(change - model @ fit) < _AGREEING_RAD
    return -float(fit[0]) if agreeing.mean() >= _AGREEING_SHARE else None
