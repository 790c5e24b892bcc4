"""Writes a drive as a LeRobotDataset of version 3 with one episode: images beside the rows, x, y, yaw, and speeds.

LeRobot assumes a constant rate, so `timestamp` is the row's number divided by the rate; the time of the robot's clock
is in `observation.time`. `camera.json` describes the lens for our own reader.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ltvn_core.data.exporting.exported_drive import ExportedDrive, ExportedFrame
from ltvn_core.geometry import relative

FRONT = "observation.images.front"
FRONT_DEPTH = "observation.images.front_depth"
STATE = "observation.state"
ACTION = "action"
TIME = "observation.time"
TASK = "drive"

_ROWS = 64
"""Number of rows in memory at a time."""
_PLACE = "chunk-000/file-000.parquet"
_IMAGE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


def write_lerobot_dataset(drive: ExportedDrive, folder: Path) -> None:
    """Fill a folder, which must exist and be empty. Raises OSError."""
    rate = max(round(drive.rate_hz), 1)
    poses = np.array([frame.odometry for frame in drive.frames()])
    stamps = np.array([frame.stamp for frame in drive.frames()])
    numbers = {STATE: poses, ACTION: _speeds(poses, stamps), TIME: stamps[:, None]}
    features = _features(drive, numbers)
    _write_rows(drive, folder / "data" / _PLACE, numbers, rate)
    _write_episode(folder / "meta/episodes" / _PLACE, len(drive))
    _write_tasks(folder / "meta/tasks.parquet")
    _write_json(folder / "meta/info.json", _info(features, len(drive), rate))
    drive.write_camera(folder)
    _write_json(folder / "meta/stats.json", {key: _statistics(column) for key, column in numbers.items()})


def _write_rows(drive: ExportedDrive, path: Path, numbers: dict[str, NDArray[np.float64]], rate: float) -> None:
    path.parent.mkdir(parents=True)
    schema = _schema(drive, numbers)
    with pq.ParquetWriter(path, schema) as writer:
        rows: list[dict[str, Any]] = []
        for number, frame in enumerate(drive.frames()):
            rows.append(_row(number, frame, numbers, rate, has_depth=drive.has_depth))
            if len(rows) == _ROWS:
                writer.write_table(pa.Table.from_pylist(rows, schema))
                rows = []
        if rows:
            writer.write_table(pa.Table.from_pylist(rows, schema))


def _row(
    number: int, frame: ExportedFrame, numbers: dict[str, NDArray[np.float64]], rate: float, *, has_depth: bool
) -> dict[str, Any]:
    row = {
        FRONT: {"bytes": frame.jpeg, "path": f"{number:06d}.jpg"},
        **{key: column[number].tolist() for key, column in numbers.items()},
        "timestamp": number / rate,
        "frame_index": number,
        "episode_index": 0,
        "index": number,
        "task_index": 0,
    }
    if has_depth:
        row[FRONT_DEPTH] = {"bytes": frame.depth_png, "path": f"{number:06d}.png"}
    return row


def _schema(drive: ExportedDrive, numbers: dict[str, NDArray[np.float64]]) -> pa.Schema:
    images = [(FRONT, _IMAGE)] + ([(FRONT_DEPTH, _IMAGE)] if drive.has_depth else [])
    floats = [(key, pa.list_(_float(key), column.shape[1])) for key, column in numbers.items()]
    counts = [(key, pa.int64()) for key in ("frame_index", "episode_index", "index", "task_index")]
    return pa.schema([*images, *floats, ("timestamp", pa.float32()), *counts])


def _float(key: str) -> pa.DataType:
    return pa.float64() if key == TIME else pa.float32()


def _features(drive: ExportedDrive, numbers: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
    size = [drive.camera.height, drive.camera.width]
    axes = ["height", "width", "channels"]
    features: dict[str, Any] = {FRONT: {"dtype": "image", "shape": [*size, 3], "names": axes}}
    if drive.has_depth:
        depth = {"is_depth_map": True, "depth_unit": "mm"}
        features[FRONT_DEPTH] = {"dtype": "image", "shape": [*size, 1], "names": axes, "info": depth}
    names = {STATE: ["x", "y", "yaw"], ACTION: ["v", "w"], TIME: ["seconds"]}
    for key, column in numbers.items():
        features[key] = {
            "dtype": "float64" if key == TIME else "float32",
            "shape": [column.shape[1]],
            "names": names[key],
        }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    for key in ("frame_index", "episode_index", "index", "task_index"):
        features[key] = {"dtype": "int64", "shape": [1], "names": None}
    return features


def _info(features: dict[str, Any], rows: int, rate: int) -> dict[str, Any]:
    return {
        "codebase_version": "v3.0",
        "robot_type": "ltvn",
        "total_episodes": 1,
        "total_frames": rows,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": "0:1"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _write_episode(path: Path, rows: int) -> None:
    path.parent.mkdir(parents=True)
    columns = {
        "episode_index": [0],
        "tasks": [[TASK]],
        "length": [rows],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [rows],
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    pq.write_table(pa.table(columns), path)


def _write_tasks(path: Path) -> None:
    """Write the table of tasks in LeRobot's layout, in which the text of a task is the index."""
    index = "__index_level_0__"
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": None, "field_name": index, "pandas_type": "unicode", "numpy_type": "object"},
    ]
    said = {"index_columns": [index], "columns": columns, "column_indexes": [], "pandas_version": "2.0.0"}
    table = pa.table({"task_index": pa.array([0], pa.int64()), index: [TASK]})
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(said)}), path)


def _speeds(poses: NDArray[np.float64], stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the forward speed and the turning rate (N, 2) between each row and the next, in m/s and rad/s; zero in the
    last."""
    speeds = np.zeros((len(poses), 2))
    if len(poses) > 1:
        seconds = np.maximum(np.diff(stamps), 1e-6)
        speeds[:-1] = relative(poses[:-1], poses[1:])[:, [0, 2]] / seconds[:, None]
    return speeds


def _statistics(column: NDArray[np.float64]) -> dict[str, Any]:
    found = {name: getattr(column, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return {**found, "count": [len(column)]}


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4), encoding="utf-8")
