"""Small databases with RTAB-Map's own tables, written by sqlite3 and OpenCV."""

import sqlite3
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 64, 48
OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
BEGIN_S = 1_600_000_000.0

SCHEMA = """
CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT, pose BLOB,
    ground_truth_pose BLOB, velocity BLOB, label TEXT, gps BLOB, env_sensors BLOB, time_enter DATE, PRIMARY KEY (id));
CREATE TABLE Data (id INTEGER NOT NULL, image BLOB, depth BLOB, calibration BLOB, scan BLOB, scan_info BLOB,
    user_data BLOB, time_enter DATE, PRIMARY KEY (id));
CREATE TABLE Link (from_id INTEGER NOT NULL, to_id INTEGER NOT NULL, type INTEGER NOT NULL,
    information_matrix BLOB NOT NULL, transform BLOB, user_data BLOB);
CREATE TABLE Admin (version TEXT, preview_image BLOB, opt_ids BLOB, opt_poses BLOB, time_enter DATE);
"""


def pose_blob(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: Rotation | None = None) -> bytes:
    rows = np.hstack([(turn or Rotation.identity()).as_matrix(), [[x], [y], [z]]])
    return rows.astype("<f4").tobytes()


def mono_blob(place: bytes, focal: float = 55.0, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    """A calibration as since version 0.18."""
    cx, cy = (width - 1) / 2, (height - 1) / 2
    k = [focal, 0, cx, 0, focal, cy, 0, 0, 1]
    p = [focal, 0, cx, 0, 0, focal, cy, 0, 0, 0, 1, 0]
    numbers = np.array([*k, *(0.1,) * 5, *np.eye(3).ravel(), *p], "<f8")
    return struct.pack("<11i", 0, 21, 0, 0, width, height, 9, 5, 9, 12, 12) + numbers.tobytes() + place


def stereo_blob(place: bytes) -> bytes:
    left, right = mono_blob(place), mono_blob(place)
    counts = (9, 3, 0, 0)
    return struct.pack("<10i", 0, 21, 0, 1, *counts, len(left), len(right)) + bytes(8 * sum(counts)) + left + right


def float_blob(place: bytes, *numbers: float) -> bytes:
    """A calibration as before version 0.18."""
    return np.array(numbers, "<f4").tobytes() + place


def mounted(x: float = 0.2, height: float = 0.5, pitch_down: float = 0.1) -> bytes:
    return pose_blob(x, 0.0, height, Rotation.from_euler("y", pitch_down) * OPTICAL)


def matrix_blob(numbers: NDArray, kind: int) -> bytes:
    return zlib.compress(numbers.tobytes()) + struct.pack("<3i", 1, numbers.size, kind)


def colours(number: int, width: int = WIDTH) -> NDArray[np.uint8]:
    rows, columns = np.mgrid[:HEIGHT, :width]
    return np.stack([rows * 4, columns % 64 * 3, np.full_like(rows, 20 * number)], axis=-1).astype(np.uint8)


def png(pixels: NDArray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def lossless(pixels: NDArray[np.uint8]) -> bytes:
    return png(pixels[..., ::-1])


@dataclass
class NodeRow:
    """What is written of one node."""

    pose: bytes
    image: bytes
    depth: bytes | None = None
    calibration: bytes = field(default_factory=lambda: mono_blob(mounted()))
    truth: bytes | None = None
    session: int = 0
    stamp: float | None = None


def write_database(
    path: Path,
    nodes: Sequence[NodeRow],
    *,
    version: str = "0.21.4",
    closures: int = 0,
    optimised: Sequence[bytes] = (),
) -> Path:
    with sqlite3.connect(path) as database:
        database.executescript(SCHEMA)
        for number, node in enumerate(nodes, start=1):
            stamp = BEGIN_S + number if node.stamp is None else node.stamp
            database.execute(
                "INSERT INTO Node (id, map_id, weight, stamp, pose, ground_truth_pose) VALUES (?, ?, 0, ?, ?, ?)",
                (number, node.session, stamp, node.pose, node.truth),
            )
            database.execute(
                "INSERT INTO Data (id, image, depth, calibration) VALUES (?, ?, ?, ?)",
                (number, node.image, node.depth, node.calibration),
            )
        links = [(count + 5, 1, 1, b"") for count in range(closures)]
        database.executemany("INSERT INTO Link (from_id, to_id, type, information_matrix) VALUES (?, ?, ?, ?)", links)
        ids = matrix_blob(np.arange(1, len(optimised) + 1, dtype="<i4"), 4) if optimised else None
        poses = matrix_blob(np.frombuffer(b"".join(optimised), "<f4"), 5) if optimised else None
        database.execute("INSERT INTO Admin (version, opt_ids, opt_poses) VALUES (?, ?, ?)", (version, ids, poses))
    database.close()
    return path


def straight_drive(count: int = 4) -> list[NodeRow]:
    depth = png(np.full((HEIGHT, WIDTH), 1500, np.uint16))
    return [NodeRow(pose_blob(0.1 * number), lossless(colours(number)), depth) for number in range(count)]
