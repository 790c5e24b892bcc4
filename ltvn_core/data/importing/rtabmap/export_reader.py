"""Reads the exports of `rtabmap-export --images --poses_camera` and of RTAB-Map on a phone: images, depth, lens, poses.

Owns the names of these files (folders of images, a lens for each image or for all, a list of poses), and the matching
of images and poses. Depth is registered to the colours, with fewer pixels; pixels of low confidence are left out.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.data.importing.foreign_files import require_within
from ltvn_core.data.importing.image_files import ImageFilesReader, without_low_confidence
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import CalibrationYaml, camera_beside, fitted
from ltvn_core.data.importing.spatial_pose import BODY_FROM_OPTICAL, Transform, is_rigid, transform
from ltvn_core.data.importing.stamped_lists import list_lines, rate_hz
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.types import Depth

_COLOUR_SUFFIXES = (".jpg", ".jpeg", ".png")
_LENS_SUFFIXES = (".yaml", ".yml")
_CAMERA_POSES = "camera_poses.txt"
_POSES = "poses.txt"
_RAW, _STAMPED, _WITH_ID = 12, 8, 9
"""Numbers of columns in RTAB-Map's pose formats: format 0; formats 1 and 10; format 11."""
_CLEARLY = 0.2
"""Least gain of uprightness (mean cosine) for which the alternative reading of the poses is preferred."""
RATE_HZ = 1.0
"""Images per second that RTAB-Map keeps by default."""
_FISHEYES = ("equidistant", "fisheye")


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFiles:
    """The files of one export."""

    rgb: Path
    depth: Path | None
    confidence: Path | None
    lens: Path | None
    """Lens file for all images, or folder with one file for each image."""
    poses: Path | None

    @classmethod
    def find(cls, folder: Path) -> Self | None:
        """Return the export in a folder; None if it holds none."""
        if not folder.is_dir() or (folder / "rgb.txt").is_file():  # TUM's layout also has these folders.
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
                rgb=rgb,
                depth=_first(near, ("depth",)),
                confidence=confidence,
                lens=lens,
                poses=poses,
            )
        return None

    def images(self) -> Sequence[Path]:
        """Return the colour images, sorted by their numbers or stamps."""
        found = (path for path in self.rgb.iterdir() if path.suffix.lower() in _COLOUR_SUFFIXES)
        return sorted(found, key=lambda path: (_number(path) is None, _number(path) or 0.0, path.name))

    def depth_of(self, image: Path) -> Path | None:
        """Return the depth image of a colour image; None if there is none."""
        return _partner(self.depth, image)

    def confidence_of(self, image: Path) -> Path | None:
        """Return the confidence file of an image's depth; None if there is none."""
        return _partner(self.confidence, image)

    def lens_of(self, image: Path) -> Path | None:
        """Return the lens file of an image; None if there is none."""
        if self.lens is None or self.lens.is_file():
            return self.lens
        own = next((path for end in _LENS_SUFFIXES if (path := self.lens / f"{image.stem}{end}").is_file()), None)
        if own is not None:
            return own
        all_of_them = sorted(path for path in self.lens.iterdir() if path.suffix in _LENS_SUFFIXES)
        return all_of_them[0] if len(all_of_them) == 1 else None


class ExportedPose(NamedTuple):
    """Pose of the camera or the robot at one image."""

    stamp: float | None
    """Time in seconds; None in lists without stamps."""
    pose: Transform
    """Pose (4, 4), in most formats in a world whose z is up."""


def read_poses(path: Path, images: Sequence[Path]) -> Mapping[Path, ExportedPose]:
    """Return the poses of images, matched by the node's number, else by the stamp in the name, else by the order.

    Raises DriveError that names the first invalid line, or says why no image has a pose.
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
            f"{path} has {len(rows)} poses for {len(images)} images, and no stamp or number that says which pose "
            "belongs to which image. Export both again with `rtabmap-export --images_id --poses_camera FILE.db`."
        )
    in_order = list(by_stamp.values()) if by_stamp else [ExportedPose(None, _matrix(numbers, path)) for numbers in rows]
    return dict(zip(images, in_order, strict=False))


def camera_poses(
    poses: NDArray[np.float64], *, are_of_camera: bool, camera_on_robot: Transform | None
) -> NDArray[np.float64]:
    """Return the poses (N, 4, 4) of the camera's optical frame from those of a list.

    Two of RTAB-Map's formats look alike: one contains plain poses, in the other (`RGBD-SLAM in motion capture frame`)
    they are rotated by the optical frame. The interpretation with the more upright camera is used.
    """
    behind = np.eye(4)
    if not are_of_camera:
        behind[:3, :3] = BODY_FROM_OPTICAL
        behind = behind if camera_on_robot is None else camera_on_robot
    turned = np.eye(4)
    turned[:3, :3] = BODY_FROM_OPTICAL.T
    plain = poses @ behind
    other = poses @ turned @ behind
    return other if _uprightness(other) > _uprightness(plain) + _CLEARLY else plain


def _uprightness(poses: NDArray[np.float64]) -> float:
    """Return the mean cosine between the camera's up direction and z, from -1 to 1."""
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
                f"{line!s:.60}. Export the poses again with `rtabmap-export --poses_camera FILE.db`."
            )
        yield numbers


def _matrix(numbers: NDArray[np.float64], path: Path) -> Transform:
    matrix = np.vstack([numbers.reshape(3, 4), [0, 0, 0, 1]])
    if not is_rigid(matrix):
        raise DriveError(f"{path}: {numbers[:4]} ... is not a pose; its rows must be r11 r12 r13 tx, and so on.")
    return matrix


def _folders(folder: Path) -> Iterator[Path]:
    """Yield the folders that may hold the colours: in the export itself, or one folder below."""
    yield from (path for path in sorted(folder.glob("rgb")) + sorted(folder.glob("*_rgb")) if path.is_dir())
    yield from (path for path in sorted(folder.glob("*/rgb")) if path.is_dir())


def _first(beginnings: Sequence[str], names: Sequence[str]) -> Path | None:
    """Return the first existing path that consists of one of the beginnings and one of the names."""
    paths = (Path(f"{beginning}{name}") for name in names for beginning in beginnings)
    return next((path for path in paths if path.exists()), None)


def _partner(folder: Path | None, image: Path) -> Path | None:
    path = None if folder is None else folder / f"{image.stem}.png"
    return path if path is not None and path.is_file() else None


def _number(path: Path) -> float | None:
    return float(path.stem) if re.fullmatch(r"[0-9]{1,12}(\.[0-9]{1,9})?", path.stem) else None


def _key(stamp: float | None) -> float:
    """Return a stamp in seconds, rounded to microseconds as in file names; NaN, which matches nothing, if there is
    none."""
    return float("nan") if stamp is None else round(float(stamp), 6)


class RtabmapExportReader(ImageFilesReader):
    """An export of RTAB-Map that is open for reading."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Read the list of poses, but no image yet. Raises DriveError."""
        super().__init__(folder, options)
        files = ExportFiles.find(folder)
        if files is None:
            raise DriveError(
                f"{folder} is not an export of RTAB-Map: it needs rgb/ with calib/, or NAME_rgb/ with NAME_calib/, as "
                "`rtabmap-export --images --poses_camera FILE.db` writes them; or name the database."
            )
        self._files = files
        self._paths = list(files.images())
        if not self._paths:
            raise DriveError(f"{files.rgb} holds no images (.jpg or .png).")
        self._described = camera_beside(self._folder)
        found = {} if files.poses is None else read_poses(self._within(files.poses), self._paths)
        self._stamps = self._known_stamps(found)
        self._paths.sort(key=self._stamps.__getitem__)
        self._truth = self._track(found) if found else None
        self.facts = DriveFacts(
            format="rtabmap",
            frames=len(self._paths),
            streams=self._streams(len(found)),
            place=self._folder.resolve().name,
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder that RTAB-Map exported. Raises OSError."""
        return ExportFiles.find(path) is not None

    def _images(self) -> Iterator[tuple[FrameMoment, Path]]:
        for path in self._paths:
            stamp = self._stamps[path]
            yield FrameMoment.with_truth(stamp, None if self._truth is None else self._truth.at(stamp)), path

    def _frame(self, moment: FrameMoment, image: Path) -> RawFrame:
        name = str(image.relative_to(self._folder))
        rgb = self._colours(name)
        depth_m = self._if_readable(lambda: self._depth(image))
        return self._raw_frame(moment, name, rgb, depth_m=depth_m, camera=self._lens(image, rgb.shape[1], rgb.shape[0]))

    def _lens(self, image: Path, width: int, height: int) -> CameraModel | None:
        said = self._options.camera or self._described.camera
        path = self._files.lens_of(image)
        if said is None and path is not None:
            said = _described_lens(self._within(path), width, height)
        return None if said is None else fitted(said, width, height, image.name)

    def _depth(self, image: Path) -> Depth | None:
        path = None if self._options.depth == NOTHING else self._files.depth_of(image)
        if path is None:
            return None
        name = str(path.relative_to(self._folder))
        unit_m = self._options.depth_unit_m or self._described.metres_per_unit or MILLIMETRES
        depth = self._depth_m(name, unit_m)
        confidence = self._files.confidence_of(image)
        return depth if confidence is None else self._trusted(depth, str(confidence.relative_to(self._folder)))

    def _trusted(self, depth: Depth, name: str) -> Depth:
        """Return depth (h, w) without pixels of low confidence, from the confidence image `name`."""
        levels = self._colours(name)[..., 0]
        if levels.shape != depth.shape:
            size = (depth.shape[1], depth.shape[0])
            levels = np.asarray(cv2.resize(levels, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        return without_low_confidence(depth, levels)

    def _known_stamps(self, found: Mapping[Path, ExportedPose]) -> dict[Path, float]:
        """Return the stamps of the images: from the list of poses, else from the file names, else from the rate."""
        listed = {image: pose.stamp for image, pose in found.items() if pose.stamp is not None}
        if listed and self._options.rate_hz is None:
            # Images without a pose are left out, because their place is unknown.
            missing = [image for image in self._paths if image not in listed]
            if missing:
                self.dropped["without a pose"] = len(missing)
                self._paths = [image for image in self._paths if image in listed]
            return listed
        try:
            if self._options.rate_hz is None and all("." in image.stem for image in self._paths):
                return {image: float(image.stem) for image in self._paths}
        except ValueError:
            pass  # Names with a point are not always numbers.
        rate = self._options.rate_hz or RATE_HZ
        if self._options.rate_hz is None:
            self.doubts.append(
                f"The images have no stamps; {RATE_HZ:g} per second are assumed; --rate sets another rate."
            )
        return {image: place / rate for place, image in enumerate(self._paths)}

    def _track(self, found: Mapping[Path, ExportedPose]) -> PoseTrack:
        images = [image for image in self._paths if image in found]
        matrices = np.stack([found[image].pose for image in images])
        of_camera = self._files.poses is not None and self._files.poses.name.endswith("camera_poses.txt")
        lens = self._files.lens_of(images[0])
        on_robot = None if lens is None else CalibrationYaml(self._within(lens)).transform("local_transform")
        matrices = camera_poses(matrices, are_of_camera=of_camera, camera_on_robot=on_robot)
        stamps, rows = np.unique([self._stamps[image] for image in images], return_index=True)
        self.doubts.append(
            "The true poses are those of RTAB-Map's own map: useful for an evaluation, but not measured."
        )
        return PoseTrack(stamps, matrices[rows, :3, 3], Rotation.from_matrix(matrices[rows, :3, :3]))

    def _streams(self, poses: int) -> list[SourceFact]:
        rate = rate_hz([self._stamps[image] for image in self._paths])
        depths = sum(self._files.depth_of(image) is not None for image in self._paths)
        poses_name = "" if self._files.poses is None else self._files.poses.name
        streams = (
            SourceFact("rgb", self._files.rgb.name, len(self._paths), rate),
            SourceFact("depth", "" if self._files.depth is None else self._files.depth.name, depths, rate),
            SourceFact("truth", poses_name, poses),
        )
        return [stream for stream in streams if stream.count]

    def _within(self, path: Path) -> Path:
        require_within(path, self._folder)
        return path


def _described_lens(path: Path, width: int, height: int) -> CameraModel:
    """Return the lens in a file of OpenCV's FileStorage; without a size in the file, for images of the given size."""
    said = CalibrationYaml(path)
    try:
        matrix = np.reshape(said.numbers("camera_matrix"), (3, 3)).tolist()
        distortion = tuple(said.numbers("distortion_coefficients"))
        is_fisheye = said.word("distortion_model") in _FISHEYES
        size = (int(said.word("image_width") or 0) or width, int(said.word("image_height") or 0) or height)
        return CameraModel(
            width=size[0],
            height=size[1],
            fx=matrix[0][0],
            fy=matrix[1][1],
            cx=matrix[0][2],
            cy=matrix[1][2],
            distortion=distortion[:4] if is_fisheye else (distortion if any(distortion) else ()),
            fisheye=is_fisheye,
        )
    except (ValueError, CameraError) as error:
        raise DriveError(
            f"{path} describes no camera ({error!s:.120}); it needs camera_matrix with 3 rows of 3 numbers. Correct "
            "it, or use --camera."
        ) from error
