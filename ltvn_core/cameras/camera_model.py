"""The camera model: image size, lens, and mounting on the robot.

Owns projection and its inverse between pixels and points in the robot's frame: x forward, y left, z up, in metres, with
the origin on the floor below the camera. Pixel coordinates are as in OpenCV and ROS: the centre of the upper left pixel
is (0, 0). `ltvn_core.cameras.rectification` converts images of one camera to those of another.

The distortion models are those of OpenCV and ROS: Brown-Conrady for ordinary lenses and Kannala-Brandt for fisheyes.
They convert between ideal and distorted points (right, down) in metres on the plane one metre in front of the lens.
Owns the valid range of a lens, which OpenCV does not check: outside of it the polynomial is no longer monotonic.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Self, TypeAlias

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import ArrayLike, NDArray

from ltvn_core.errors import CameraError

Points: TypeAlias = NDArray[np.float64]
"""(..., 2) points: right and down, at one metre of depth."""
PLUMB_BOB_COUNTS = (0, 4, 5, 8)
"""Possible numbers of coefficients of an ordinary lens: none; k1 k2 p1 p2; with k3; with k3 k4 k5 k6."""
FISHEYE_COUNT = 4
"""Number of coefficients of a fisheye: k1 k2 k3 k4."""
_WIDEST_RADIUS = 10.0
"""Largest radius up to which the valid range of an ordinary lens is checked, 84 degrees off the axis."""
_TOLERANCE = 1e-8
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
_NO_CAMERA = np.eye(3)
"""Identity camera matrix for OpenCV, because points are already on the plane one metre in front of the lens."""
MILLIMETRES = 0.001
"""`depth_scale` of depth images in whole millimetres, as ROS's 16UC1."""
MAX_SIDE_PX = 65_535
"""Largest width and height of an image in pixels, the limit of JPEG."""


def distort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the distorted points (..., 2) of ideal points for an ordinary lens; NaN outside its valid range."""
    if not coefficients:
        return points
    beyond = np.hypot(points[..., 0], points[..., 1]) > _largest_radius(coefficients)
    return np.where(beyond[..., None], np.nan, _plumb_bob(points, coefficients))


def _plumb_bob(points: Points, coefficients: tuple[float, ...]) -> Points:
    still = np.zeros(3)

    def seen(flat: Points) -> MatLike:
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
        return cv2.projectPoints(rays, still, still, _NO_CAMERA, np.array(coefficients))[0]

    return _for_all(points, seen)


def undistort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) of distorted points for an ordinary lens; NaN if there is none."""
    if not coefficients:
        return points
    known = np.array(coefficients)
    ideal = _for_all(points, lambda flat: cv2.undistortPoints(flat, _NO_CAMERA, known, criteria=_CRITERIA))
    # Outside the lens's valid range, the search returns an arbitrary point; distorting it again detects this.
    missed = ~(np.abs(distort(ideal, coefficients) - points).max(axis=-1) < _TOLERANCE)
    return np.where(missed[..., None], np.nan, ideal)


def distort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the distorted points (..., 2) of ideal points for a fisheye."""
    return _for_all(points, lambda flat: cv2.fisheye.distortPoints(flat, _NO_CAMERA, np.array(coefficients)))


def undistort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) of distorted points for a fisheye; NaN if there is none in front of the lens."""
    known = np.array(coefficients)
    ideal = _for_all(points, lambda flat: cv2.fisheye.undistortPoints(flat, _NO_CAMERA, known, criteria=_CRITERIA))
    missed = ~(np.abs(distort_fisheye(ideal, coefficients) - points).max(axis=-1) < _TOLERANCE)
    return np.where(missed[..., None], np.nan, ideal)


def _for_all(points: Points, function: Callable[[Points], MatLike]) -> Points:
    """Apply an OpenCV function for points (N, 1, 2) to points (..., 2); an empty array is returned unchanged."""
    if not points.size:
        return points
    found = function(np.ascontiguousarray(points.reshape(-1, 1, 2)))
    return np.asarray(found, np.float64).reshape(points.shape)


@lru_cache(maxsize=32)
def _largest_radius(coefficients: tuple[float, ...]) -> float:
    """Return the radius of a lens's valid range, beyond which its polynomial is no longer monotonic."""
    radii = np.linspace(0, _WIDEST_RADIUS, 4001)
    seen = _plumb_bob(
        np.stack([radii, np.zeros_like(radii)], axis=-1), (*coefficients[:2], 0.0, 0.0, *coefficients[4:])
    )
    folds = np.flatnonzero(np.diff(seen[:, 0]) <= 0)
    return float(radii[folds[0]]) if len(folds) else float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraModel:
    """The image size, lens and mounting of a camera. Raises CameraError for an invalid field."""

    width: int
    """Width of its images in pixels."""
    height: int
    """Height of its images in pixels."""
    fx: float
    """Focal length along a row, in pixels."""
    fy: float
    """Focal length along a column, in pixels."""
    cx: float
    """Column of the principal point, in pixels from the centre of the top left pixel."""
    cy: float
    """Row of the principal point, in pixels from the centre of the top left pixel."""
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients: none, k1 k2 p1 p2, with k3, with k4 k5 k6; for a fisheye k1 k2 k3 k4."""
    fisheye: bool = False
    """Whether the lens is a fisheye (OpenCV's `fisheye`, ROS's `equidistant`)."""
    height_m: float = 0.0
    """Height of the optical centre above the floor, in metres."""
    pitch_rad: float = 0.0
    """Pitch of the optical axis in radians, positive upwards; 0 is level."""
    roll_rad: float = 0.0
    """Roll about the optical axis in radians; positive lowers the camera's right side."""
    quarter_turns: int = 0
    """Number of counter-clockwise rotations by 90 degrees (`numpy.rot90`) that make its images upright."""
    depth_scale: float = 1.0
    """Metres per unit of its depth image: 1 for metres, 0.001 for millimetres."""

    def __post_init__(self) -> None:
        """Check every field."""
        self._check_size_and_lens()
        self._check_mounting()

    @classmethod
    def from_fov(
        cls,
        width: int,
        height: int,
        horizontal_fov_rad: float,
        *,
        height_m: float = 0.0,
        pitch_rad: float = 0.0,
    ) -> Self:
        """Return a camera with square pixels and a centred, undistorted lens of the given field of view."""
        if not 0 < horizontal_fov_rad < math.pi:
            raise CameraError(
                f"A horizontal field of view must lie between 0 and 180 degrees, got "
                f"{math.degrees(horizontal_fov_rad):g}; for a wider lens, give its distortion and set `fisheye`."
            )
        focal_px = width / 2 / float(np.tan(horizontal_fov_rad / 2))
        return cls(
            width=width,
            height=height,
            fx=focal_px,
            fy=focal_px,
            cx=width / 2 - 0.5,
            cy=height / 2 - 0.5,
            height_m=height_m,
            pitch_rad=pitch_rad,
        )

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> Self:
        """Read the output of `to_json`, or the five keys of older recordings, in which cameras had no lens model.

        Raises TypeError, KeyError or CameraError for anything else.
        """
        if "horizontal_fov_rad" in fields:
            return cls.from_fov(**fields)
        return cls(**{**fields, "distortion": tuple(fields["distortion"])})

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values."""
        return {**asdict(self), "distortion": list(self.distortion)}

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle in radians between the left and the right border of the middle row."""
        if self.distortion or self.fisheye:
            return self._angle_between((-0.5, self.cy), (self.width - 0.5, self.cy))
        return float(np.arctan((self.cx + 0.5) / self.fx) + np.arctan((self.width - 0.5 - self.cx) / self.fx))

    @property
    def vertical_fov_rad(self) -> float:
        """Angle in radians between the upper and the lower border of the middle column."""
        if self.distortion or self.fisheye:
            return self._angle_between((self.cx, -0.5), (self.cx, self.height - 0.5))
        return float(np.arctan((self.cy + 0.5) / self.fy) + np.arctan((self.height - 0.5 - self.cy) / self.fy))

    def _angle_between(self, *pixels: tuple[float, float]) -> float:
        """Return the angle in radians between two border pixels, at most 90 degrees to each side."""
        away = np.linalg.norm(self.pixels_to_rays(np.array(pixels)), axis=1)
        return float(np.arctan(np.nan_to_num(away, nan=np.inf)).sum())

    @property
    def aspect(self) -> float:
        """Aspect ratio of its images, width over height."""
        return self.width / self.height

    def scaled(self, width: int, height: int) -> "CameraModel":
        """Return the same camera with resized images; lens and mounting stay."""
        across = width / self.width
        down = height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * across,
            fy=self.fy * down,
            cx=(self.cx + 0.5) * across - 0.5,
            cy=(self.cy + 0.5) * down - 0.5,
        )

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return columns and rows (..., 2) of points (..., 3) in the robot's frame; NaN for points behind the lens.

        A point outside the field of view has coordinates outside the image.
        """
        points = np.asarray(points, np.float64)
        ray = (points - np.array([0.0, 0.0, self.height_m])) @ self.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.where(ray[..., 0] > 0, ray[..., 0], np.nan)
            return self.rays_to_pixels(np.stack([-ray[..., 1] / ahead, -ray[..., 2] / ahead], axis=-1))

    def unproject(self, pixels: ArrayLike, depth_m: ArrayLike) -> NDArray[np.float64]:
        """Return the points (..., 3) in the robot's frame seen at pixels (..., 2), `depth_m` (...) along the axis."""
        right_down = self.pixels_to_rays(np.asarray(pixels, np.float64))
        ahead = np.asarray(depth_m, np.float64)
        left = -right_down[..., 0] * ahead
        up = -right_down[..., 1] * ahead
        if not (self.pitch_rad or self.roll_rad or self.quarter_turns):
            # A level camera needs no rotation, so its points are exact.
            return np.stack([ahead, left, up + self.height_m], axis=-1)
        return np.stack([ahead, left, up], axis=-1) @ self.rotation.T + np.array([0.0, 0.0, self.height_m])

    def unproject_image(self, depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the points (M, 3) in the robot's frame of a depth image (H, W) in metres; pixels of 0 have none."""
        rows, columns = np.nonzero(depth_m > 0)
        return self.unproject(np.stack([columns, rows], axis=-1), depth_m[rows, columns])

    def pixels_to_rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rays (..., 2) of pixels (..., 2): right and down from the axis, at one metre of depth."""
        plane = (pixels - np.array([self.cx, self.cy])) / np.array([self.fx, self.fy])
        return (undistort_fisheye if self.fisheye else undistort)(plane, self.distortion)

    def rays_to_pixels(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels (..., 2) of rays (..., 2); the inverse of `pixels_to_rays`.

        NaN for rays outside the valid range of an ordinary lens.
        """
        plane = (distort_fisheye if self.fisheye else distort)(rays, self.distortion)
        return plane * np.array([self.fx, self.fy]) + np.array([self.cx, self.cy])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the axes of the camera's images (forward, left, up) to the robot's frame."""
        sin, cos = _sin_cos(self.pitch_rad)
        pitch = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
        sin, cos = _sin_cos(self.roll_rad)
        roll = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
        # A counter-clockwise rotation moves the right side of an image (minus left) to its top.
        quarter = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        return pitch @ roll @ np.linalg.matrix_power(quarter, self.quarter_turns).astype(np.float64)

    def _check_size_and_lens(self) -> None:
        if not (_is_side(self.width) and _is_side(self.height)):
            raise CameraError(
                f"A camera's width and height must be whole numbers of pixels, at least 1 and at most {MAX_SIDE_PX:,}, "
                f"got {self.width} x {self.height}."
            )
        if not (_finite(self.fx, self.fy, self.cx, self.cy) and min(self.fx, self.fy) > 0):
            raise CameraError(
                f"A camera's fx, fy must be positive and cx, cy finite, in pixels, got {self.fx}, {self.fy}, {self.cx} "
                f"and {self.cy}. They are items 0, 4, 2 and 5 of ROS's CameraInfo.k; `from_fov` takes an angle."
            )
        counts = (FISHEYE_COUNT,) if self.fisheye else PLUMB_BOB_COUNTS
        if len(self.distortion) not in counts or not _finite(*self.distortion):
            raise CameraError(
                f"A {'fisheye' if self.fisheye else 'camera'} takes {' or '.join(map(str, counts))} finite distortion "
                f"coefficients in OpenCV's order, got {self.distortion}."
            )

    def _check_mounting(self) -> None:
        if not (_finite(self.height_m, self.pitch_rad, self.roll_rad) and abs(self.pitch_rad) < math.pi / 2):
            raise CameraError(
                f"A camera's height must be finite metres and its pitch and roll finite radians, the pitch less than a "
                f"right angle, got {self.height_m}, {self.pitch_rad}, {self.roll_rad}."
            )
        if self.quarter_turns not in (0, 1, 2, 3):
            raise CameraError(f"quarter_turns must be 0, 1, 2 or 3, got {self.quarter_turns}.")
        if not (_finite(self.depth_scale) and self.depth_scale > 0):
            raise CameraError(
                f"depth_scale is the metres per unit of the depth image and positive, got {self.depth_scale}; use 1 "
                f"for metres and {MILLIMETRES} for millimetres."
            )


def _is_side(pixels: object) -> bool:
    return isinstance(pixels, int) and not isinstance(pixels, bool) and 0 < pixels <= MAX_SIDE_PX


def _finite(*values: float) -> bool:
    try:
        return all(math.isfinite(value) for value in values)
    except (TypeError, OverflowError):  # NaN, or a number that is too large to convert.
        return False


def _sin_cos(angle_rad: float) -> tuple[float, float]:
    return math.sin(angle_rad), math.cos(angle_rad)
