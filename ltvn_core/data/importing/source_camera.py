"""The description of a drive's camera: numbers on the command line, `camera.json`, or a calibration file in simple
YAML.

Owns these formats, Replica's `cam_params.json`, and the fit of a camera to the size of the images. Does not guess:
without a given lens there is no camera. The YAML parser reads names with words and lists of numbers, as in the files of
OpenCV and EuRoC, which needs no library. YAML's references and tags, which could expand a small file to a large one,
are not interpreted.
"""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.data.importing.spatial_pose import Transform, is_rigid
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.structured_text import parse_json

CAMERA_FILE = "camera.json"
REPLICA_FILE = "cam_params.json"
"""Camera file in NICE-SLAM's copy of Replica, beside one room or in the folder of all rooms."""
HOW_TO = (
    "give it with --camera fx,fy,cx,cy,width,height (in pixels, then the distortion k1,k2,p1,p2,k3 if there is any), "
    "or roughly with --fov DEGREES, the horizontal field of view"
)
"""Advice for a message about an unknown lens."""
HOW_TO_SCALE = (
    'write {"depth_scale": N} into a camera.json, where N is the number of units in a metre (1000 for millimetres), '
    "and name the file with --camera"
)
"""Advice for a message about depth in another unit."""

_SIX = 6
_ASPECT_TOLERANCE = 0.02
_MOST_BYTES = 1_000_000
_MOST_YAML_BYTES = 100_000
_NAME = re.compile(r"^([A-Za-z_]\w*)[ \t]*:", re.MULTILINE)
_COMMENT = re.compile(r"(?:^|(?<=\s))#.*$", re.MULTILINE)
_LIST = re.compile(r"\[([^\[\]]*)\]")
_ITEM = re.compile(r"^[ \t]*-[ \t]+(\S+)[ \t]*$", re.MULTILINE)
"""Pattern of a list with one number per line."""


class CameraFile(NamedTuple):
    """Content of a `camera.json`; None for missing fields."""

    camera: CameraModel | None
    """Camera of the colour images."""
    depth_focal_px: float | None
    """Focal length in pixels (`depth_fx_nominal`) of depth images that are not registered to the colours."""
    metres_per_unit: float | None
    """Metres per unit of the depth images."""


def parse_camera(text: str) -> CameraModel:
    """Read `fx,fy,cx,cy,width,height[,k1,k2,p1,p2[,k3[,k4,k5,k6]]]`. Raises DriveError."""
    try:
        numbers = [float(part) for part in text.split(",")]
        fx, fy, cx, cy, width, height = numbers[:_SIX]
        return _camera(fx, fy, cx, cy, width=width, height=height, distortion=numbers[_SIX:])
    except (ValueError, OverflowError, CameraError) as error:
        raise DriveError(f"--camera {text!s:.80} is not a camera ({error!s:.160}); {HOW_TO}.") from error


def read_camera_option(text: str) -> CameraFile:
    """Read the user's description of a camera: numbers, or a `camera.json`, which may contain only the unit of depth.
    Raises DriveError."""
    if not text.endswith(".json"):
        return CameraFile(parse_camera(text), None, None)
    said = read_camera_file(Path(text))
    if said.camera is None and said.metres_per_unit is None:
        raise DriveError(
            f"{text} has neither a lens (width, height, fx, fy, cx and cy in pixels) nor a unit of depth (depth_scale)."
        )
    return said


def read_camera_file(path: Path) -> CameraFile:
    """Read a `camera.json`.

    It has `width`, `height`, `fx`, `fy`, `cx`, `cy`, and if known `distortion`, `fisheye`, `height_m`, `pitch_rad`,
    `roll_rad`, `quarter_turns` and `depth_scale`. A `depth_scale` above 1 is in units per metre (5000 in TUM's files),
    a smaller one in metres per unit. A focal length of null means that the lens is unknown. Raises DriveError for an
    invalid file.
    """
    return _described(path, lambda said: said, "width, height, fx, fy, cx and cy in pixels")


def _described(path: Path, fields_of: Callable[[Any], dict[str, Any]], needs: str) -> CameraFile:
    """Return what a JSON file says, whose object `fields_of` turns into the fields of a `camera.json`."""
    try:
        fields = fields_of(parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what=path.name)))
        if not isinstance(fields, dict):
            raise ValueError("it is not a JSON object")
        scale = _positive(fields, "depth_scale")
        unit_m = 1 / scale if scale is not None and scale > 1 else scale
        return CameraFile(_file_camera(fields), _positive(fields, "depth_fx_nominal"), unit_m)
    except (OSError, ValueError, TypeError, KeyError, OverflowError, CameraError) as error:
        raise DriveError(
            f"{path} describes no camera ({type(error).__name__}: {error!s:.160}); it needs {needs}. Correct it, or "
            "remove it and use --camera."
        ) from error


def camera_beside(folder: Path) -> CameraFile:
    """Read the `camera.json` of a folder, or Replica's own file; without either, all fields are None. Raises
    DriveError."""
    if (folder / CAMERA_FILE).is_file():
        return read_camera_file(folder / CAMERA_FILE)
    if (folder / REPLICA_FILE).is_file():
        return _described(folder / REPLICA_FILE, _of_replica, "w, h, fx, fy, cx, cy and scale under camera")
    return CameraFile(None, None, None)


def _of_replica(said: Any) -> dict[str, Any]:
    fields = said["camera"]
    return {**fields, "width": fields["w"], "height": fields["h"], "depth_scale": fields.get("scale")}


def camera_of_fov(width: int, height: int, horizontal_fov_deg: float) -> CameraModel:
    """Return a camera with a centred, undistorted lens. Raises DriveError for an impossible angle."""
    try:
        return CameraModel.from_fov(width, height, math.radians(horizontal_fov_deg))
    except CameraError as error:
        raise DriveError(f"--fov {horizontal_fov_deg:g}: {error}") from error


def fitted(camera: CameraModel, width: int, height: int, source: str) -> CameraModel:
    """Return a camera scaled to images of the given size. Raises DriveError if their aspect ratio differs."""
    if (camera.width, camera.height) == (width, height):
        return camera
    if abs(width / height / camera.aspect - 1) > _ASPECT_TOLERANCE:
        raise DriveError(
            f"{source}: the images are {width} x {height}, but the camera's are {camera.width} x {camera.height}, "
            f"with another aspect ratio, so it is not the camera of these images; {HOW_TO}."
        )
    return camera.scaled(width, height)


def _file_camera(fields: dict[str, Any]) -> CameraModel | None:
    if any(fields.get(name) is None for name in ("fx", "fy", "cx", "cy")):
        return None
    return _camera(
        *(float(fields[name]) for name in ("fx", "fy", "cx", "cy")),
        width=float(fields["width"]),
        height=float(fields["height"]),
        distortion=[float(number) for number in fields.get("distortion") or ()],
        fisheye=bool(fields.get("fisheye", False)),
        height_m=float(fields.get("height_m") or 0.0),
        pitch_rad=float(fields.get("pitch_rad") or 0.0),
        roll_rad=float(fields.get("roll_rad") or 0.0),
        quarter_turns=int(fields.get("quarter_turns") or 0),
    )


def _camera(
    fx: float, fy: float, cx: float, cy: float, *, width: float, height: float, distortion: list[float], **mounting: Any
) -> CameraModel:
    if not (width.is_integer() and height.is_integer()):
        raise CameraError(f"width and height are whole numbers of pixels, got {width} and {height}")
    if not any(distortion) and not mounting.get("fisheye"):
        distortion = []
    return CameraModel(
        width=int(width),
        height=int(height),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=tuple(distortion),
        **mounting,
    )


def _positive(fields: dict[str, Any], name: str) -> float | None:
    if fields.get(name) is None:
        return None
    number = float(fields[name])
    if not 0 < number < math.inf:
        raise ValueError(f"{name} must be positive, got {number}")
    return number


class CalibrationYaml:
    """Content of a calibration file, by the names at the beginning of its lines."""

    def __init__(self, path: Path, *, what: str = "calibration") -> None:
        """Read a file; messages call it `what`. Raises DriveError if it is not text or too long."""
        self._path = path
        try:
            text = read_foreign(path, most_bytes=_MOST_YAML_BYTES, what=what).decode("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise DriveError(f"{path} cannot be read as text ({error!s:.120}).") from error
        parts = _NAME.split(_COMMENT.sub("", text))
        self._values = dict(zip(parts[1::2], parts[2::2], strict=True))

    def word(self, name: str) -> str:
        """Return the text after a name on its line; empty if the file does not have the name."""
        return (self._values.get(name, "").strip().splitlines() or [""])[0].strip().strip("\"'")

    def numbers(self, name: str) -> Sequence[float]:
        """Return the list after a name, or its `data`; empty if the file has none. Raises DriveError."""
        value = self._values.get(name, "")
        found = _LIST.search(value)
        try:
            words = found.group(1).split(",") if found else _ITEM.findall(value)
            numbers = [float(word) for word in words if word.strip()]
        except ValueError as error:
            raise DriveError(f"{self._path}: {name} is not a list of numbers ({error!s:.80}).") from error
        if not np.isfinite(numbers).all():
            raise DriveError(f"{self._path}: {name} holds numbers that are not finite.")
        return numbers

    def transform(self, name: str) -> Transform | None:
        """Return a 3D pose (4, 4) from 3 or 4 rows of 4 numbers; None if the file has none. Raises DriveError."""
        numbers = self.numbers(name)
        if not numbers:
            return None
        matrix = np.eye(4)
        if len(numbers) in (12, 16):
            matrix[:3] = np.reshape(numbers[:12], (3, 4))
        if len(numbers) not in (12, 16) or not is_rigid(matrix):
            raise DriveError(f"{self._path}: {name} is not a pose; write 3 or 4 rows of 4 numbers, rotation first.")
        return matrix
