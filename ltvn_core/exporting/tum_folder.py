"""Writes a drive in the layout of the TUM RGB-D benchmark, which many SLAM programs read.

`rgb.txt`, `depth.txt`, `odometry.txt` and `groundtruth.txt` list stamps; poses are of the camera's optical frame, and
depth has 5000 units a metre. `camera.json` says what the lens is, as our own reader takes it.
"""

from pathlib import Path

import cv2
import numpy as np

from ltvn_core.exporting.exported_drive import CameraPlace, ExportedDrive

UNITS_PER_METRE = 5000
_FARTHEST = 65535
_POSE_HEAD = "# stamp tx ty tz qx qy qz qw of the camera: x right, y down, z forward\n"


def write_tum_folder(drive: ExportedDrive, folder: Path) -> None:
    """Fill a folder, which exists and is empty. Depth beyond 13.1 m becomes no return. Raises OSError."""
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
