"""Exports a recording to another format; an output file or folder appears only when it is complete.

Owns the list of formats, and the two formats that need no library. The layout of the TUM RGB-D benchmark, which many
SLAM programs read, has `rgb.txt`, `depth.txt`, `odometry.txt` and `groundtruth.txt` with stamps; poses are those of the
camera's optical frame, and depth has 5000 units per metre. The layout of GNM, ViNT and NoMaD has `0.jpg`, `1.jpg`, ...
and `traj_data.pkl`. Both contain a `camera.json`, which describes the lens for our own reader.
"""

import pickle
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from ltvn_core.atomic_files import atomic_output, new_folder
from ltvn_core.data.exporting.exported_drive import CameraPlace, ExportedDrive
from ltvn_core.data.exporting.map_files import PlacedMap, placed_map, write_geojson, write_graphml, write_nav2_route
from ltvn_core.data.recording.reader import Recording
from ltvn_core.extras import naming_the_extra
from ltvn_core.types import Pose

UNITS_PER_METRE = 5000
_FARTHEST = 65535
_POSE_HEAD = "# stamp tx ty tz qx qy qz qw of the camera: x right, y down, z forward\n"


def write_tum_folder(drive: ExportedDrive, folder: Path) -> None:
    """Fill a folder, which must exist and be empty. Depth beyond 13.1 m is written as no return. Raises OSError."""
    (folder / "rgb").mkdir()
    (folder / "depth").mkdir()
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "odometry": [], "groundtruth": []}
    for frame in drive.frames():
        stamp = f"{frame.stamp:.6f}"
        (folder / f"rgb/{stamp}.jpg").write_bytes(frame.jpeg)
        lists["rgb"].append(f"{stamp} rgb/{stamp}.jpg\n")
        if (depth := frame.depth_m) is not None:
            units = np.rint(depth * UNITS_PER_METRE)
            png = cv2.imencode(".png", np.where(units <= _FARTHEST, units, 0).astype(np.uint16))[1]
            (folder / f"depth/{stamp}.png").write_bytes(png.tobytes())
            lists["depth"].append(f"{stamp} depth/{stamp}.png\n")
        lists["odometry"].append(_pose_line(stamp, drive.in_world(frame.odometry, frame.tilt)))
        if frame.truth is not None:
            lists["groundtruth"].append(_pose_line(stamp, drive.in_world(frame.truth, frame.tilt)))
    for name, lines in lists.items():
        if lines:
            head = "# stamp file\n" if name in ("rgb", "depth") else _POSE_HEAD
            (folder / f"{name}.txt").write_text(head + "".join(lines), encoding="utf-8")
    drive.write_camera(folder, units_per_metre=UNITS_PER_METRE)


def _pose_line(stamp: str, place: CameraPlace) -> str:
    numbers = [*place.position, *place.rotation.as_quat()]
    return " ".join([stamp, *(f"{number:.9f}" for number in numbers)]) + "\n"


def write_vint_folder(drive: ExportedDrive, folder: Path) -> None:
    """Fill a folder, which must exist and be empty, with images and odometry.

    Depth and stamps are left out, because the format has no place for them. Raises OSError.
    """
    poses = []
    for number, frame in enumerate(drive.frames()):
        (folder / f"{number}.jpg").write_bytes(frame.jpeg)
        poses.append(frame.odometry)
    drive.write_camera(folder)
    held = np.array(poses, np.float64)
    (folder / "traj_data.pkl").write_bytes(pickle.dumps({"position": held[:, :2].copy(), "yaw": held[:, 2].copy()}, 4))


class ExportFormat(Enum):
    """Formats of an export: the first four hold a drive, the others a map."""

    MCAP = "mcap"
    TUM = "tum"
    VINT = "vint"
    LEROBOT = "lerobot"
    GRAPHML = "graphml"
    GEOJSON = "geojson"
    NAV2_ROUTE = "nav2-route"

    @property
    def is_map(self) -> bool:
        """Whether the format holds a map; otherwise it holds a drive."""
        return self in _MAPS


class Exported(NamedTuple):
    """Counts of an export."""

    frames: int | None
    """Number of frames written; None for a map."""
    nodes: int | None
    """Number of nodes written; None for a drive."""
    edges: int | None


_MAPS: dict[ExportFormat, Callable[[PlacedMap, Path], None]] = {
    ExportFormat.GRAPHML: write_graphml,
    ExportFormat.GEOJSON: write_geojson,
    ExportFormat.NAV2_ROUTE: write_nav2_route,
}


def export_recording(
    recording: Recording,
    output: Path | str,
    to: ExportFormat,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    frame: Pose | None = None,
) -> Exported:
    """Write a map to a new file, or a drive to a new folder; an output whose name ends in .mcap is one file.

    A map is written in the frame whose pose (3,) in the map's own frame is `frame`; the default is the map's own frame.

    Raises RecordingError where `output` exists or cannot be written, MapError if there is no map, and
    MissingLibraryError where a library is missing.
    """
    output = Path(output)
    if to.is_map:
        placed = placed_map(recording)
        if frame is not None:
            placed = placed.seen_from(frame)
        with atomic_output(output) as part:
            _MAPS[to](placed, part)
        return Exported(None, len(placed.graph.nodes), len(placed.graph.edges))
    drive = ExportedDrive(recording, from_s=from_s, to_s=to_s)
    write = _writer(to)
    if to is ExportFormat.MCAP:
        _write_bag(drive, output, write)
    else:
        with new_folder(output) as part:
            write(drive, part)
    return Exported(len(drive), None, None)


def _write_bag(drive: ExportedDrive, output: Path, write: Callable[[ExportedDrive, Path], None]) -> None:
    """Write a folder with a bag, or only the file of the bag; the library names that file after its folder."""
    with new_folder(output, leave=f"{output.stem}/{output.name}" if output.suffix == ".mcap" else output.name) as part:
        write(drive, part / output.stem if output.suffix == ".mcap" else part / output.name)


def _writer(to: ExportFormat) -> Callable[[ExportedDrive, Path], None]:
    with naming_the_extra():
        match to:
            case ExportFormat.MCAP:
                from ltvn_core.data.exporting.ros_bag import write_ros_bag as write
            case ExportFormat.LEROBOT:
                from ltvn_core.data.exporting.lerobot_dataset import write_lerobot_dataset as write
            case ExportFormat.VINT:
                write = write_vint_folder
            case _:
                write = write_tum_folder
    return write
