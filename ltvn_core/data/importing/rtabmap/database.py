"""Rows of RTAB-Map's database: nodes with poses and cameras, images on demand, loop closures, and the optimised map.

Owns the file, the queries and the limits, and both layouts of the calibration blobs (lens, size, and pose on the
robot). Before version 0.18 a blob contains only floats; since then it has a header of integers, matrices of doubles,
and the pose in floats. Images in a database are rectified, so the projection matrix applies and there is no distortion.
Opens the file read-only, and trusts no length in it.
"""

import re
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.spatial_pose import Transform
from ltvn_core.data.importing.unfinished_databases import finished
from ltvn_core.errors import CameraError, DriveError

POSE_FLOATS = 12
"""Number of floats of a pose: (3, 4) in rows, rotation and position."""
_MONO = 0
_STEREO = 1
_MONO_HEAD = struct.Struct("<11i")
"""Version in three numbers, type, width, height, then the lengths of K, D, R, P and the pose."""
_STEREO_HEAD = struct.Struct("<10i")
"""Version, type, the numbers of doubles in four matrices, then the numbers of bytes of the left and the right
camera."""
_MOST_CAMERAS = 16
_MOST_BYTES = 100_000
MAX_BLOB_BYTES = 2**27
"""Largest size of a value in bytes; images have a few megabytes."""
_OLDEST = (0, 10)
_CLOSURES = (1, 2, 3, 4)
"""Types of loop closures: global, near in space, near in time, and added by hand."""
_MOST_STEPS = 100_000
"""Number of steps of sqlite's virtual machine between two checks of a query."""
_MOST_LOOKS = 20_000
"""Largest number of checks in one query, which takes minutes; a query over a normal table ends in seconds."""
_MATRIX_TAIL = 12
"""Number of bytes after a compressed matrix, with its rows, columns and type."""


class RigCamera(NamedTuple):
    """A camera of the rig."""

    lens: CameraModel | None
    """Lens without mounting; None if the database does not contain its size."""
    place: Transform
    """Pose (4, 4) of the optical frame in the robot's frame."""
    focal: tuple[float, float, float, float]
    """Focal lengths and principal point in pixels: fx, fy, cx, cy."""
    is_stereo: bool = False
    """Whether this is the left camera of a stereo pair; the stored depth is then the right image."""

    def fitted(self, width: int, height: int) -> CameraModel:
        """Return the lens for images of this size. Raises CameraError."""
        if self.lens is not None:
            if abs(width / height / self.lens.aspect - 1) > 0.02:
                raise CameraError(
                    f"the images are {width} x {height}, but their calibration is for {self.lens.width} x "
                    f"{self.lens.height}"
                )
            same = (self.lens.width, self.lens.height) == (width, height)
            return self.lens if same else self.lens.scaled(width, height)
        fx, fy, cx, cy = self.focal
        return CameraModel(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


def parse_pose(blob: object) -> Transform | None:
    """Return a pose (4, 4) from its blob; None if there is none or it is not finite."""
    if not isinstance(blob, bytes) or len(blob) != 4 * POSE_FLOATS:
        return None
    rows = np.frombuffer(blob, "<f4").astype(np.float64).reshape(3, 4)
    if not np.isfinite(rows).all() or not 0.5 < np.linalg.det(rows[:, :3]) < 1.5:
        return None
    left, _, right = np.linalg.svd(rows[:, :3])  # The rotation has only the precision of floats.
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    pose[:3, 3] = rows[:, 3]
    return pose


def parse_calibration(blob: bytes, version: tuple[int, ...], source: str) -> list[RigCamera]:
    """Return the cameras of a calibration; for a stereo camera, only the left one. Raises DriveError if it is
    damaged."""
    try:
        if len(blob) > _MOST_BYTES:
            raise ValueError(f"it has {len(blob):,} bytes")
        cameras = _floats(blob, version) if version < (0, 18) else _records(blob)
        if not cameras:
            raise ValueError("it has no camera")
        return cameras
    except (ValueError, struct.error, CameraError, IndexError) as error:
        raise DriveError(
            f"{source}: the calibration is damaged ({error!s:.120}); give the lens with --camera."
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
    """Return the camera whose record begins at the byte `start`, and the length of the record in bytes."""
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
        raise ValueError(f"it claims calibrations of impossible lengths: {counts}")
    return counts


def _floats(blob: bytes, version: tuple[int, ...]) -> list[RigCamera]:
    """Return the cameras of the older layout: fx, fy, cx, cy, the baseline of a stereo camera, the size since 0.11.2,
    the pose."""
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Node:
    """A node of RTAB-Map's map."""

    id: int
    session: int
    """Number of the session; odometry restarts in each session."""
    stamp: float
    """Time in seconds; 0 if it is unknown."""
    odometry: Transform | None
    """Odometry pose (4, 4) of the robot; None if it is unknown."""
    truth: Transform | None
    """True pose (4, 4) of the robot in the world; None if it is unknown."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeImages:
    """The stored images of a node."""

    colours: bytes
    depth: bytes | None
    """The stored depth image; for a stereo camera, the right image."""
    calibration: bytes


class RtabmapDatabase:
    """A database that is open for reading. Raises DriveError if it is damaged or from another program."""

    def __init__(self, path: Path) -> None:
        """Open the file and check that it is RTAB-Map's."""
        self.path = path
        self._file = finished(path, self)
        tables = {row[0] for row in self._rows("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {b"Node", b"Data", b"Admin"} <= tables:
            raise DriveError(f"{path} is not a database of RTAB-Map: it lacks its tables Node, Data and Admin.")
        (text,) = next(self._rows("SELECT version FROM Admin LIMIT 1"), (None,))
        words = text.decode(errors="replace") if isinstance(text, bytes) else ""
        numbers = re.match(r"(\d{1,4})\.(\d{1,4})(?:\.(\d{1,4}))?", words)
        if numbers is None:
            raise DriveError(f"{path} is not a database of RTAB-Map: its version is {words!r:.40}.")
        self.version = tuple(int(part or 0) for part in numbers.groups())
        if self.version < _OLDEST:
            raise DriveError(
                f"{path} was written by RTAB-Map {'.'.join(map(str, self.version))}, but only 0.10 and later are "
                "supported; open it in a newer RTAB-Map, which converts it."
            )

    def nodes(self) -> list[Node]:
        """Return all nodes that have an image, in the order of their ids."""
        truth = "ground_truth_pose" if "ground_truth_pose" in self._columns("Node") else "NULL"
        rows = self._rows(
            f"SELECT Node.id, map_id, stamp, pose, {truth} FROM Node JOIN Data ON Node.id = Data.id "
            "WHERE length(image) > 0 ORDER BY Node.id"
        )
        return [
            Node(
                id=_whole(number),
                session=_whole(session),
                stamp=float(stamp) if isinstance(stamp, float | int) and np.isfinite(stamp) else 0.0,
                odometry=parse_pose(pose),
                truth=parse_pose(true_pose),
            )
            for number, session, stamp, pose, true_pose in rows
        ]

    def images(self, node: Node) -> NodeImages:
        """Return the images of a node."""
        query = "SELECT image, depth, calibration FROM Data WHERE id = ?"
        colours, depth, calibration = next(self._rows(query, (node.id,)), (None, None, None))
        if not isinstance(colours, bytes):
            raise DriveError(f"{self.path}: node {node.id} has no image.")
        return NodeImages(
            colours=colours,
            depth=depth if isinstance(depth, bytes) and len(depth) > 4 else None,
            calibration=calibration if isinstance(calibration, bytes) else b"",
        )

    def closures(self) -> int:
        """Return the number of loop closures that RTAB-Map found."""
        if not self._columns("Link"):
            return 0
        places = ", ".join("?" * len(_CLOSURES))
        query = f"SELECT count(*) FROM Link WHERE type IN ({places}) AND from_id > to_id"
        return _whole(next(self._rows(query, _CLOSURES))[0])

    def optimised(self) -> dict[int, Transform]:
        """Return the poses (4, 4) of the optimised map by node; empty if there is no readable one."""
        if not {"opt_ids", "opt_poses"} <= self._columns("Admin"):
            return {}
        ids, poses = next(self._rows("SELECT opt_ids, opt_poses FROM Admin LIMIT 1"), (None, None))
        numbers = _matrix(ids, "<i4")
        floats = _matrix(poses, "<f4")
        if numbers is None or floats is None or len(floats) != POSE_FLOATS * len(numbers):
            return {}
        found = {
            int(number): parse_pose(row.tobytes()) for number, row in zip(numbers, floats.reshape(-1, 12), strict=True)
        }
        return {number: pose for number, pose in found.items() if pose is not None}

    def _columns(self, table: str) -> set[str]:
        return {row[1].decode(errors="replace") for row in self._rows(f"PRAGMA table_info({table})")}

    def _rows(self, query: str, values: tuple[int, ...] = ()) -> Iterator[tuple[Any, ...]]:
        looks = 0

        def watch() -> int:
            """Stop a query that takes minutes; a malicious table could make it run forever."""
            nonlocal looks
            looks += 1
            return int(looks > _MOST_LOOKS)

        try:
            file = f"{self._file.resolve().as_uri()}?mode=ro&immutable=1"
            with closing(sqlite3.connect(file, uri=True)) as connection:
                connection.text_factory = bytes
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BLOB_BYTES)
                connection.execute("PRAGMA trusted_schema = OFF")
                connection.set_progress_handler(watch, _MOST_STEPS)
                yield from connection.execute(query, values)
        except (sqlite3.Error, OverflowError, MemoryError, UnicodeError, ValueError) as error:
            raise DriveError(
                f"{self.path} cannot be read as a database of RTAB-Map ({error!s:.120}); if RTAB-Map was stopped "
                "while writing, repair it with `rtabmap-recovery`."
            ) from error


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0


def _matrix(blob: object, dtype: str) -> np.ndarray | None:
    """Return the numbers of a matrix that was compressed with zlib; None if it is damaged."""
    if not isinstance(blob, bytes) or len(blob) <= _MATRIX_TAIL:
        return None
    rows, columns, _ = np.frombuffer(blob[-_MATRIX_TAIL:], "<i4")
    size = int(rows) * int(columns) * np.dtype(dtype).itemsize
    if not 0 < size <= MAX_BLOB_BYTES:
        return None
    try:
        raw = zlib.decompressobj().decompress(blob[:-_MATRIX_TAIL], size + 1)
    except zlib.error:
        return None
    return np.frombuffer(raw, dtype) if len(raw) == size else None
