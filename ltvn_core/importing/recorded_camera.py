"""The camera of an imported recording: the source's own lens, undistorted, upright, and at most 320 x 240 pixels.

Owns the choice of that camera. `ltvn_core.cameras.rectification` makes its images.
"""

import math
from dataclasses import replace

import cv2
import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.preprocessing import ORIGINAL_SIZE

WIDEST_FOV_RAD = math.radians(110)
"""A wider image without distortion is stretched so much at its rim that nothing there can be recognised."""

_MOST_CHANGE = 3.0
"""OpenCV's own search for the undistorted lens has failed where the focal length changes by more."""


def recorded_camera(source: CameraModel) -> CameraModel:
    """Return the camera to whose images those of `source` are turned; pitch and height stay, roll is undone."""
    upright = _upright(_undistorted(source))
    long_side, short_side = max(upright.width, upright.height), min(upright.width, upright.height)
    scale = min(1.0, ORIGINAL_SIZE.long_side / long_side, ORIGINAL_SIZE.short_side / short_side)
    if scale == 1.0:
        return upright
    return upright.scaled(max(round(upright.width * scale), 1), max(round(upright.height * scale), 1))


def _undistorted(source: CameraModel) -> CameraModel:
    """Return a lens without distortion that sees no farther than the source does, so that nothing stays black."""
    if not (source.distortion or source.fisheye):
        return source
    matrix = np.array([[source.fx, 0, source.cx], [0, source.fy, source.cy], [0, 0, 1]])
    coefficients, size = np.array(source.distortion), (source.width, source.height)
    if source.fisheye:
        found = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(
            matrix, coefficients, size, np.eye(3), balance=0.0
        )
    else:
        found, _ = cv2.getOptimalNewCameraMatrix(matrix, coefficients, size, 0.0)
    ideal = replace(source, distortion=(), fisheye=False)
    fx, fy, cx, cy = (float(found[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    least_px = source.width / 2 / math.tan(WIDEST_FOV_RAD / 2)
    if not all(1 / _MOST_CHANGE < new / old < _MOST_CHANGE for new, old in ((fx, source.fx), (fy, source.fy))):
        fx, fy, cx, cy = source.fx, source.fy, source.cx, source.cy
    if fx < least_px:
        fy, fx = fy * least_px / fx, least_px
    return replace(ideal, fx=fx, fy=fy, cx=cx, cy=cy)


def _upright(source: CameraModel) -> CameraModel:
    """Return an ideal camera as if it were mounted without quarter turns and roll."""
    width, height = source.width, source.height
    places = {
        0: (source.cx, source.cy),
        1: (source.cy, width - 1 - source.cx),
        2: (width - 1 - source.cx, height - 1 - source.cy),
        3: (height - 1 - source.cy, source.cx),
    }
    cx, cy = places[source.quarter_turns]
    level = replace(source, cx=cx, cy=cy, quarter_turns=0, roll_rad=0.0, depth_scale=1.0)
    if source.quarter_turns % 2 == 0:
        return level
    return replace(level, width=height, height=width, fx=source.fy, fy=source.fx)
