"""What `rtabmap-export` and RTAB-Map on a phone write: folders of images, a lens for each or for all, a list of poses.

Owns the names of these files, and which image belongs to which pose.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import DriveError
from ltvn_core.importing.calibration_yaml import is_rigid
from ltvn_core.importing.moving_frame import Transform, transform
from ltvn_core.importing.spatial_pose import BODY_FROM_OPTICAL
from ltvn_core.importing.text_lists import list_lines

_COLOUR_SUFFIXES = (".jpg", ".jpeg", ".png")
_LENS_SUFFIXES = (".yaml", ".yml")
_CAMERA_POSES, _POSES = "camera_poses.txt", "poses.txt"
_RAW, _STAMPED, _WITH_ID = 12, 8, 9
"""Columns of the formats 0, of 1 and 10, and of 11."""
_CLEARLY = 0.2
"""The other of two readings is taken where the camera is so much more upright by it, as the cosine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFiles:
    """The files of one export."""

    folder: Path
    rgb: Path
    depth: Path | None
    confidence: Path | None
    lens: Path | None
    """A file for all images, or a folder with one for each."""
    poses: Path | None

    @classmethod
    def find(cls, folder: Path) -> Self | None:
        """Return the files of a folder; None where they are not those of an export."""
        if not folder.is_dir() or (folder / "rgb.txt").is_file():  # TUM's layout has folders of the same names.
            return None
        for rgb in _folders(folder):
            prefix = rgb.name.removesuffix("rgb")
            near = [f"{root}/{prefix}" for root in dict.fromkeys((rgb.parent, folder))]
            lens = _first(near, ("calib", "calibration.yaml", "calib.yaml"))
            confidence = _first(near, ("confidence",))
            if lens is None and (confidence is None or not confidence.is_dir()):
                continue
            poses = _first(near, (_CAMERA_POSES, _POSES)) or next(iter(sorted(folder.glob(f"*_{_POSES}"))), None)
            return cls(
                folder=folder,
                rgb=rgb,
                depth=_first(near, ("depth",)),
                confidence=confidence,
                lens=lens,
                poses=poses,
            )
        return None

    def images(self) -> Sequence[Path]:
        """Return the colour images, by their numbers or stamps."""
        found = (path for path in self.rgb.iterdir() if path.suffix.lower() in _COLOUR_SUFFIXES)
        return sorted(found, key=lambda path: (_number(path) is None, _number(path) or 0.0, path.name))

    def depth_of(self, image: Path) -> Path | None:
        """Return the depth image of an image, where it has one."""
        return _partner(self.depth, image)

    def confidence_of(self, image: Path) -> Path | None:
        """Return how far the depth of an image may be trusted, where that is told."""
        return _partner(self.confidence, image)

    def lens_of(self, image: Path) -> Path | None:
        """Return the description of an image's lens, where there is one."""
        if self.lens is None or self.lens.is_file():
            return self.lens
        own = next((path for end in _LENS_SUFFIXES if (path := self.lens / f"{image.stem}{end}").is_file()), None)
        if own is not None:
            return own
        all_of_them = sorted(path for path in self.lens.iterdir() if path.suffix in _LENS_SUFFIXES)
        return all_of_them[0] if len(all_of_them) == 1 else None


class ExportedPose(NamedTuple):
    """Where the camera or the robot was at one image."""

    stamp: float | None
    """Seconds; None in lists without stamps."""
    pose: Transform
    """(4, 4) in a world whose z is up in most formats."""


def read_poses(path: Path, images: Sequence[Path]) -> Mapping[Path, ExportedPose]:
    """Return the poses of images: by the node's number, by the stamp in the name, else by the order.

    Raises DriveError that names the first line that cannot be right, or says why no image has a pose.
    """
    rows = list(_rows(path))
    by_stamp: dict[float, ExportedPose] = {}
    by_node: dict[float, ExportedPose] = {}
    for numbers in rows:
        if len(numbers) == _RAW:
            continue
        pose = transform(numbers[1:4], numbers[4:8])
        if pose is None:
            raise DriveError(f"{path}: the pose at {numbers[0]} is not finite, or its quaternion is zero.")
        by_stamp[_key(numbers[0])] = ExportedPose(float(numbers[0]), pose)
        if len(numbers) == _WITH_ID:
            by_node[numbers[8]] = by_stamp[_key(numbers[0])]
    for named in (by_node, by_stamp):
        found = {image: named[key] for image in images if (key := _key(_number(image))) in named}
        if found:
            return found
    if len(rows) != len(images):
        raise DriveError(
            f"{path} has {len(rows)} poses for {len(images)} images, and no stamp or number that names one of them. "
            "Export both anew by `rtabmap-export --images_id --poses_camera FILE.db`."
        )
    in_order = list(by_stamp.values()) if by_stamp else [ExportedPose(None, _matrix(numbers, path)) for numbers in rows]
    return dict(zip(images, in_order, strict=False))


def camera_poses(
    poses: NDArray[np.float64], *, are_of_camera: bool, camera_on_robot: Transform | None
) -> NDArray[np.float64]:
    """Return the poses (N, 4, 4) of the camera's optical frame out of those of a list.

    Two of RTAB-Map's formats look alike: one holds poses as they are, the other has turned them by the optical frame
    (`RGBD-SLAM in motion capture frame`). The reading by which the camera is carried more upright is taken.
    """
    behind = np.eye(4)
    if not are_of_camera:
        behind[:3, :3] = BODY_FROM_OPTICAL
        behind = behind if camera_on_robot is None else camera_on_robot
    turned = np.eye(4)
    turned[:3, :3] = BODY_FROM_OPTICAL.T
    plain, other = poses @ behind, poses @ turned @ behind
    return other if _uprightness(other) > _uprightness(plain) + _CLEARLY else plain


def _uprightness(poses: NDArray[np.float64]) -> float:
    """Return how far up the camera's up is on average, from -1 to 1."""
    return float(-poses[:, 2, 1].mean())


def _rows(path: Path) -> Iterator[NDArray[np.float64]]:
    for number, line, words in list_lines(path, "list of poses"):
        try:
            numbers = np.array([float(word) for word in words])
        except ValueError:
            numbers = np.empty(0)
        if len(numbers) not in (_STAMPED, _WITH_ID, _RAW) or not np.isfinite(numbers).all():
            raise DriveError(
                f"{path}, line {number}: expected stamp x y z qx qy qz qw (and a number), or 3 rows of 4 numbers, got "
                f"{line!s:.60}. Export the poses anew by `rtabmap-export --poses_camera FILE.db`."
            )
        yield numbers


def _matrix(numbers: NDArray[np.float64], path: Path) -> Transform:
    matrix = np.vstack([numbers.reshape(3, 4), [0, 0, 0, 1]])
    if not is_rigid(matrix):
        raise DriveError(f"{path}: {numbers[:4]} and so on is no pose; its rows are r11 r12 r13 tx and so on.")
    return matrix


def _folders(folder: Path) -> Iterator[Path]:
    """Yield folders that may hold the colours: of the export itself, or one folder below."""
    yield from (path for path in sorted(folder.glob("rgb")) + sorted(folder.glob("*_rgb")) if path.is_dir())
    yield from (path for path in sorted(folder.glob("*/rgb")) if path.is_dir())


def _first(beginnings: Sequence[str], names: Sequence[str]) -> Path | None:
    """Return the first path that exists and is called so."""
    paths = (Path(f"{beginning}{name}") for name in names for beginning in beginnings)
    return next((path for path in paths if path.exists()), None)


def _partner(folder: Path | None, image: Path) -> Path | None:
    path = None if folder is None else folder / f"{image.stem}.png"
    return path if path is not None and path.is_file() else None


def _number(path: Path) -> float | None:
    return float(path.stem) if re.fullmatch(r"[0-9]{1,12}(\.[0-9]{1,9})?", path.stem) else None


def _key(stamp: float | None) -> float:
    """Return a stamp as file names have it, in whole microseconds; a name without a number is never found."""
    return float("nan") if stamp is None else round(float(stamp), 6)
