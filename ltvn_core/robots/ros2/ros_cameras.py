"""ROS's CameraInfo as a camera model: the lens of raw or of rectified images."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import CameraError, DriveError

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_FISHEYES = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4")
_ORDINARY = ("", "plumb_bob", "rational_polynomial", "none", "brown conrady", "brown_conrady")
"""Distortion models of ordinary lenses; the last two are `plumb_bob` in the SDK of RealSense cameras."""


class _Lens(NamedTuple):
    """Focal lengths and the centre of the image in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def is_known(self) -> bool:
        return bool(np.isfinite(self).all()) and self.fx > 0 and self.fy > 0


def is_calibrated(info: Any) -> bool:
    """Tell whether K or P of a CameraInfo is set; drivers without a calibration send zeros."""
    return any(lens.is_known for lens in _lenses(info))


def ros_camera(info: Any, width: int, height: int, *, rectified: bool, topic: str) -> CameraModel:
    """Return the camera of images of that size, level and of unknown height.

    Args:
        info: The CameraInfo message, of ROS 1 or 2.
        width: Columns of the images, which a driver may have binned or cropped.
        height: Rows of the images.
        rectified: Whether the images are rectified, so that P applies instead of K and D. If only P is set, as by
            stereo cameras, the images count as rectified.
        topic: Topic of the message, for error messages.

    Raises:
        DriveError: The message does not describe a camera of such images.
    """
    raw, ideal = _lenses(info)
    rectified = rectified or not raw.is_known
    lens = ideal if rectified and ideal.is_known else raw
    fisheye, distortion = (False, ()) if rectified else _distortion(info, topic)
    try:
        camera = CameraModel(
            width=int(info.width) or width,
            height=int(info.height) or height,
            **lens._asdict(),
            distortion=distortion,
            fisheye=fisheye,
        )
        return _fitted(camera, info, width, height)
    except CameraError as error:
        raise DriveError(f"{topic}: {error} Give the camera with --camera.") from error


def _fitted(camera: CameraModel, info: Any, width: int, height: int) -> CameraModel:
    """Return the camera for the size of the images, after cropping and binning."""
    roi = info.roi
    if 0 < int(roi.width) < camera.width or 0 < int(roi.height) < camera.height:
        camera = replace(
            camera,
            width=int(roi.width),
            height=int(roi.height),
            cx=camera.cx - int(roi.x_offset),
            cy=camera.cy - int(roi.y_offset),
        )
    if (camera.width, camera.height) == (width, height):
        return camera
    if abs(camera.width * height - camera.height * width) > 0.02 * camera.width * height:
        raise CameraError(
            f"the camera's images are {camera.width} x {camera.height} but these images are {width} x {height}."
        )
    return camera.scaled(width, height)


def _distortion(info: Any, topic: str) -> tuple[bool, tuple[float, ...]]:
    """Return whether the lens is a fisheye, and its coefficients without trailing zeros."""
    model = str(info.distortion_model).lower()
    numbers = tuple(float(number) for number in _numbers(info, "d"))
    if model in _FISHEYES:
        return True, numbers[:4]
    if model not in _ORDINARY and any(numbers):
        raise DriveError(
            f"{topic}: the distortion model {model!r:.40} is not one of "
            f"{', '.join((*_ORDINARY[1:3], *_FISHEYES[:1]))}; give the camera with --camera."
        )
    for count in (0, 4, 5, 8):
        if not any(numbers[count:]):
            return False, (numbers + (0.0,) * count)[:count]
    raise DriveError(
        f"{topic}: {len(numbers)} distortion coefficients, but at most 8 are supported; give the camera with --camera."
    )


def _lenses(info: Any) -> tuple[_Lens, _Lens]:
    """Return the lens of raw images by K, and of rectified ones by P."""
    k = _numbers(info, "k").tolist()
    p = _numbers(info, "p").tolist()
    return _Lens(k[0], k[4], k[2], k[5]), _Lens(p[0], p[5], p[2], p[6])


def _numbers(info: Any, name: str) -> np.ndarray:
    """Return a field by its name, which is in lower case in ROS 2 and in upper case in ROS 1."""
    found = getattr(info, name, None)
    numbers = np.asarray(getattr(info, name.upper(), ()) if found is None else found, np.float64)
    return numbers if numbers.size or name == "d" else np.zeros(12)
