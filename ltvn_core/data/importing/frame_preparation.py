"""Turns a raw frame into an observation of the recorded camera: upright, scaled, depth aligned with the colours.

Owns the choice of that camera, the maps from the source's cameras to it, and the treatment of an unknown lens. The
recorded camera has the source's own lens, is upright, and has at most 320 x 240 pixels. Its distortion is kept, because
undistorting stretches and crops an image, and key points are found best in the original; measurements use the camera's
rays. `ltvn_core.cameras.rectification` makes its images. Does not select frames.
"""

from dataclasses import replace

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import rectification
from ltvn_core.data.importing.raw_frame import RawFrame
from ltvn_core.data.importing.source_camera import HOW_TO, camera_of_fov, fitted
from ltvn_core.errors import DriveError, ImageError
from ltvn_core.image_validity import check_observation
from ltvn_core.preprocessing import ORIGINAL_SIZE
from ltvn_core.types import Depth, FrameId, Observation, Pose

ASSUMED_FOV_DEG = 60.0
"""Assumed horizontal field of view in degrees; right within 15 degrees for most cameras of phones, laptops and
robots."""
_ASPECT_TOLERANCE = 0.02


def recorded_camera(source: CameraModel) -> CameraModel:
    """Return the recorded camera for images of `source`; pitch and height stay, roll is removed."""
    upright = _upright(source)
    long_side = max(upright.width, upright.height)
    short_side = min(upright.width, upright.height)
    scale = min(1.0, ORIGINAL_SIZE.long_side / long_side, ORIGINAL_SIZE.short_side / short_side)
    if scale == 1.0:
        return upright
    return upright.scaled(max(round(upright.width * scale), 1), max(round(upright.height * scale), 1))


def _upright(source: CameraModel) -> CameraModel:
    """Return a camera as if it were mounted without quarter turns and roll."""
    level = replace(source, quarter_turns=0, roll_rad=0.0, depth_scale=1.0)
    for _ in range(source.quarter_turns):
        distortion = level.distortion
        if distortion and not level.fisheye:  # p1 and p2 (k1 k2 p1 p2 ...) are a direction, which turns too.
            down, right = distortion[2:4]
            distortion = (*distortion[:2], -right, down, *distortion[4:])
        level = replace(
            level,
            width=level.height,
            height=level.width,
            fx=level.fy,
            fy=level.fx,
            cx=level.cy,
            cy=level.width - 1 - level.cx,
            distortion=distortion,
        )
    return level


class FramePreparation:
    """Prepares the frames of one drive; its first frame decides on the camera."""

    def __init__(self, first: RawFrame, *, fov_deg: float | None = None, unread: str = "") -> None:
        """Choose the camera; `unread` says what could describe it. Raises DriveError for depth of an unknown lens."""
        height, width = first.rgb.shape[:2]
        self.is_lens_known = first.camera is not None or fov_deg is not None
        """Whether the source or the user described the lens."""
        if not self.is_lens_known and first.depth_m is not None:
            raise DriveError(
                f"The lens is unknown that took {first.name or 'these images'} ({width} x {height}), and depth needs "
                f"it{unread}: {HOW_TO}."
            )
        self._source = first.camera or camera_of_fov(width, height, fov_deg or ASSUMED_FOV_DEG)
        self.camera = recorded_camera(self._source)
        """The camera of all observations; its tilt is that of the source's mounting."""
        self.is_depth_registered = first.depth_camera is None
        """Whether depth is registered to the colours; otherwise only the two lenses align it with them."""

    def observation(self, raw: RawFrame, *, step: FrameId, odometry: Pose) -> Observation:
        """Return a frame as the recorded camera sees it.

        Raises ImageError for impossible values, and for an image from another camera.
        """
        height, width = raw.rgb.shape[:2]
        try:
            source = fitted(raw.camera or self._source, width, height, raw.name)
        except DriveError as error:
            raise ImageError(str(error)) from error
        if raw.tilt is not None:  # The image of a frame with a tilt of its own is not rotated.
            source = replace(source, pitch_rad=0.0, roll_rad=0.0)
        target = replace(self.camera, pitch_rad=source.pitch_rad)
        checked = check_observation(
            raw.rgb, None, odometry, stamp=raw.stamp, step=step, tilt=raw.tilt, source=raw.name or "image"
        )
        depth = None if raw.depth_m is None else self._depth(raw.depth_m, raw, source, target)
        return check_observation(
            rectification(source, target).rectify_rgb(checked.rgb),
            depth,
            odometry,
            stamp=raw.stamp,
            step=step,
            exact_pose=None if raw.truth is None else np.asarray(raw.truth, np.float64),
            tilt=raw.tilt,
            source=raw.name or "image",
        )

    def _depth(self, depth_m: Depth, raw: RawFrame, source: CameraModel, target: CameraModel) -> Depth:
        """Return depth (H, W) as the recorded camera sees it; negative, NaN and infinite values become no return."""
        height, width = depth_m.shape
        if raw.depth_camera is not None:
            lens = replace(
                raw.depth_camera,
                pitch_rad=source.pitch_rad,
                roll_rad=source.roll_rad,
                quarter_turns=source.quarter_turns,
            )
        elif abs(width / height / source.aspect - 1) < _ASPECT_TOLERANCE:
            lens = source.scaled(width, height)
        else:
            raise ImageError(
                f"{raw.name}: the depth image is {width} x {height} and the image {source.width} x {source.height}. "
                "Their aspect ratios differ, so depth is not registered to the colours; name registered images with "
                "--depth, or omit depth with --depth none."
            )
        usable = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0).astype(np.float32)
        return rectification(lens, target).rectify_depth(usable)
