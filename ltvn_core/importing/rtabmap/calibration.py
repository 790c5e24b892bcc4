"""The cameras in RTAB-Map's calibration blobs: lens, size, and place on the robot.

Owns both layouts: floats alone before version 0.18, and since then a head of whole numbers, matrices of doubles and the
place in floats. Images in a database are rectified, so the projection matrix holds and no distortion is left.
"""

import struct
from typing import NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.importing.moving_frame import Transform

POSE_FLOATS = 12
"""A pose is (3, 4) floats in rows: rotation and place."""

_MONO, _STEREO = 0, 1
_MONO_HEAD = struct.Struct("<11i")
"""Version in three numbers, kind, width, height, then how many numbers K, D, R, P and the place have."""
_STEREO_HEAD = struct.Struct("<10i")
"""Version, kind, how many doubles follow in four matrices, then how many bytes the left and the right camera have."""
_MOST_CAMERAS = 16
_MOST_BYTES = 100_000


class RigCamera(NamedTuple):
    """A camera of the rig."""

    lens: CameraModel | None
    """Level; None where the database does not say its size."""
    place: Transform
    """(4, 4): its optical frame in the robot's frame."""
    focal: tuple[float, float, float, float]
    """fx, fy, cx, cy in pixels."""
    is_stereo: bool = False
    """It is the left one of two, and what is stored as its depth is the right one's image."""

    def fitted(self, width: int, height: int) -> CameraModel:
        """Return the lens for images of a size. Raises CameraError."""
        if self.lens is not None:
            return self.lens if (self.lens.width, self.lens.height) == (width, height) else self._scaled(width, height)
        fx, fy, cx, cy = self.focal
        return CameraModel(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)

    def _scaled(self, width: int, height: int) -> CameraModel:
        assert self.lens is not None
        if abs(width / height / self.lens.aspect - 1) > 0.02:
            raise CameraError(
                f"the images are {width} x {height}, but their calibration is of {self.lens.width} x {self.lens.height}"
            )
        return self.lens.scaled(width, height)


def parse_pose(blob: object) -> Transform | None:
    """Return a pose (4, 4) from its blob, None where there is none or where it is not finite."""
    if not isinstance(blob, bytes) or len(blob) != 4 * POSE_FLOATS:
        return None
    rows = np.frombuffer(blob, "<f4").astype(np.float64).reshape(3, 4)
    if not np.isfinite(rows).all() or not 0.5 < np.linalg.det(rows[:, :3]) < 1.5:
        return None
    left, _, right = np.linalg.svd(rows[:, :3])  # Floats are rotations up to a millionth.
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    pose[:3, 3] = rows[:, 3]
    return pose


def parse_calibration(blob: bytes, version: tuple[int, ...], source: str) -> list[RigCamera]:
    """Return the cameras of a calibration, of a stereo camera the left one. Raises DriveError where it is damaged."""
    try:
        if len(blob) > _MOST_BYTES:
            raise ValueError(f"it has {len(blob):,} bytes")
        cameras = _floats(blob, version) if version < (0, 18) else _records(blob)
        if not cameras:
            raise ValueError("it has no camera")
        return cameras
    except (ValueError, struct.error, CameraError, IndexError) as error:
        raise DriveError(
            f"{source}: the calibration is damaged ({error!s:.120}); give the lens by --camera."
        ) from error


def _records(blob: bytes) -> list[RigCamera]:
    cameras: list[RigCamera] = []
    start = 0
    while start < len(blob) and len(cameras) < _MOST_CAMERAS:
        kind = struct.unpack_from("<4i", blob, start)[3]
        if kind == _STEREO:
            counts = _STEREO_HEAD.unpack_from(blob, start)[4:]
            left = start + _STEREO_HEAD.size + 8 * sum(_counted(counts[:4]))
            camera = _record(blob, left)[0]._replace(is_stereo=True)
            length = _STEREO_HEAD.size + 8 * sum(counts[:4]) + sum(_counted(counts[4:]))
        elif kind == _MONO:
            camera, length = _record(blob, start)
        else:
            raise ValueError(f"a camera of kind {kind}")
        cameras.append(camera)
        start += length
    return cameras


def _record(blob: bytes, start: int) -> tuple[RigCamera, int]:
    """Return the camera that begins at a byte, and of how many bytes it is."""
    *_, width, height, k, d, r, p, place = _MONO_HEAD.unpack_from(blob, start)
    k, d, r, p, place = _counted((k, d, r, p, place))
    at = start + _MONO_HEAD.size
    numbers = np.frombuffer(blob, "<f8", k + d + r + p, at)
    matrix, rows = (numbers[k + d + r :], 4) if p == 12 else (numbers[:k], 3)
    if p != 12 and k != 9:
        raise ValueError("it has no camera matrix")
    focal = (float(matrix[0]), float(matrix[rows + 1]), float(matrix[2]), float(matrix[rows + 2]))
    at += 8 * len(numbers)
    pose = parse_pose(blob[at : at + 4 * place]) if place == POSE_FLOATS else None
    return _camera(focal, width, height, pose), at + 4 * place - start


def _counted(counts: tuple[int, ...]) -> tuple[int, ...]:
    if any(not 0 <= count <= _MOST_BYTES for count in counts):
        raise ValueError(f"lengths of {counts}")
    return counts


def _floats(blob: bytes, version: tuple[int, ...]) -> list[RigCamera]:
    """Return cameras of fx, fy, cx, cy, of a stereo camera the baseline, since 0.11.2 the size, and the place."""
    numbers = np.frombuffer(blob, "<f4")
    count = 6 if version >= (0, 11, 2) else 4
    is_stereo = len(numbers) % (count + POSE_FLOATS) > 0
    count += is_stereo
    if len(numbers) % (count + POSE_FLOATS):
        raise ValueError(f"{len(numbers)} numbers")
    cameras = []
    for each in numbers.reshape(-1, count + POSE_FLOATS)[:_MOST_CAMERAS]:
        fx, fy, cx, cy = map(float, each[:4])
        width, height = map(int, each[count - 2 : count]) if count > 5 else (0, 0)
        camera = _camera((fx, fy, cx, cy), width, height, parse_pose(each[count:].tobytes()))
        cameras.append(camera._replace(is_stereo=is_stereo))
    return cameras


def _camera(focal: tuple[float, float, float, float], width: int, height: int, place: Transform | None) -> RigCamera:
    fx, fy, cx, cy = focal
    lens = CameraModel(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy) if width and height else None
    return RigCamera(lens, np.eye(4) if place is None else place, focal)
