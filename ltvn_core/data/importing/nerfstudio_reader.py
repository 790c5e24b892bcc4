"""Reads nerfstudio's `transforms.json`: images with a lens and a camera-to-world pose in OpenGL's axes, without stamps.

Its images are taken in the natural order of their names. Depth images are 16-bit PNGs in millimetres. Poses that COLMAP
computed have no unit, so they are not used.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame, listed_streams
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.data.importing.pose_track import picture_poses
from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.data.importing.spatial_pose import OPTICAL_FROM_GRAPHICS, Transform
from ltvn_core.data.importing.stamped_lists import natural_order
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json

LIST = "transforms.json"
_MOST_BYTES = 100_000_000
_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_FISHEYE = "OPENCV_FISHEYE"
_BY_COLMAP = ("colmap_im_id", "sharpness")
"""Fields that only programs that run COLMAP write for an image."""


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the list, but no image. Raises DriveError."""
    path = folder / LIST
    try:
        said = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what=LIST))
        is_scaled = not any(name in frame for frame in said["frames"] for name in _BY_COLMAP)
        listed = [(_listed_frame(said, frame), _pose(frame["transform_matrix"])) for frame in said["frames"]]
        unit_m = float(said.get("depth_unit_scale_factor") or MILLIMETRES)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise DriveError(
            f"{path} lists no images ({type(error).__name__}: {error!s:.120}); it needs frames with file_path and "
            "transform_matrix, and fl_x, fl_y, cx, cy, w and h in pixels."
        ) from error
    listed.sort(key=lambda each: natural_order(each[0].colour))
    frames = [frame for frame, _ in listed]
    return FileDrive(
        format="nerfstudio",
        folder=folder,
        frames=frames,
        streams=listed_streams(frames, LIST, options),
        poses=picture_poses([pose for _, pose in listed], LIST) if is_scaled else None,
        has_fixed_names=True,
        depth_unit_m=unit_m,
        doubts=[
            f"{LIST} does not say the unit of its positions, and metres were assumed."
            if is_scaled
            else f"The poses in {LIST} were computed by COLMAP from the images alone, in a unit of its own and not in "
            "metres, so they were not used. Poses of a device that measures, such as a phone, are used."
        ],
    )


NERFSTUDIO = FolderFormat(lambda path: (path / LIST).is_file(), _listed_drive)
"""Folders with a `transforms.json`."""


def _listed_frame(said: Mapping[str, Any], frame: Mapping[str, Any]) -> ListedFrame:
    colour = _name(frame["file_path"])
    depth = frame.get("depth_file_path")
    lens = _lens({**said, **frame})
    return ListedFrame(
        colour=colour if Path(colour).suffix else f"{colour}.png",
        depth=None if depth is None else _name(depth),
        lens=None if lens is None else lens.camera,
    )


def _name(said: Any) -> str:
    return str(said).replace("\\", "/").removeprefix("./")


def _pose(rows: Any) -> Transform:
    matrix = np.eye(4)
    numbers = np.asarray(rows, np.float64)
    if numbers.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a transform_matrix has the shape {numbers.shape}")
    matrix[:3] = numbers[:3]
    return matrix @ OPTICAL_FROM_GRAPHICS


def _lens(said: Mapping[str, Any]) -> FileLens | None:
    """Return the lens of an image; None if it is not described, or of an unsupported kind."""
    model = str(said.get("camera_model") or _PINHOLES[0]).upper()
    if model not in (*_PINHOLES, _FISHEYE) or "w" not in said or "h" not in said:
        return None
    width, height = int(said["w"]), int(said["h"])
    if "fl_x" in said:
        fx = float(said["fl_x"])
    elif "camera_angle_x" in said:
        fx = width / 2 / math.tan(float(said["camera_angle_x"]) / 2)
    else:
        return None
    named = ("k1", "k2", "k3", "k4") if model == _FISHEYE else ("k1", "k2", "p1", "p2", "k3")
    return FileLens(
        source=LIST,
        fx=fx,
        fy=float(said.get("fl_y", fx)),
        cx=float(said.get("cx", (width - 1) / 2)),
        cy=float(said.get("cy", (height - 1) / 2)),
        size=(width, height),
        distortion=tuple(float(said.get(name) or 0.0) for name in named),
        fisheye=model == _FISHEYE,
    )
