"""Reads the exports of `rtabmap-export --images --poses_camera` and of RTAB-Map on a phone: images, depth, lens, poses.

Owns the names of these files (folders of images, a lens for each image or for all, a list of poses), and the matching
of images and poses. Depth is registered to the colours, with fewer pixels; pixels of low confidence are left out.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.foreign_files import require_within
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import CalibrationYaml, camera_beside
from ltvn_core.data.importing.spatial_pose import BODY_FROM_OPTICAL, Transform, is_rigid, transform
from ltvn_core.data.importing.stamped_lists import list_lines, rate_hz
from ltvn_core.errors import DriveError

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
        # The colours are in the export itself, or one folder below.
        found = [each for name in ("rgb", "*_rgb", "*/rgb") for each in sorted(folder.glob(name)) if each.is_dir()]
        for rgb in found:
            prefix = rgb.name.removesuffix("rgb")
            near = [f"{root}/{prefix}" for root in dict.fromkeys((rgb.parent, folder))]
            lens = _first(near, ("calib", "calibration.yaml", "calib.yaml"))
            confidence = _first(near, ("confidence",))
            if lens is None and (confidence is None or not confidence.is_dir()):
                continue
            poses = _first(near, (_CAMERA_POSES, _POSES)) or next(iter(sorted(folder.glob(f"*_{_POSES}"))), None)
            return cls(rgb=rgb, depth=_first(near, ("depth",)), confidence=confidence, lens=lens, poses=poses)
        return None

    def images(self) -> Sequence[Path]:
        """Return the colour images, sorted by their numbers or stamps."""
        found = (path for path in self.rgb.iterdir() if path.suffix.lower() in _COLOUR_SUFFIXES)
        return sorted(found, key=lambda path: (_number(path) is None, _number(path) or 0.0, path.name))

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
    in_order = list(by_stamp.values())
    for numbers in [] if by_stamp else rows:
        in_order.append(ExportedPose(None, np.vstack([numbers.reshape(3, 4), [0, 0, 0, 1]])))
        if not is_rigid(in_order[-1].pose):
            raise DriveError(f"{path}: {numbers[:4]} ... is not a pose; its rows must be r11 r12 r13 tx, and so on.")
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


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the list of poses, but no image. Raises DriveError."""
    files = ExportFiles.find(folder)
    if files is None:
        raise DriveError(
            f"{folder} is not an export of RTAB-Map: it needs rgb/ with calib/, or NAME_rgb/ with NAME_calib/, as "
            "`rtabmap-export --images --poses_camera FILE.db` writes them; or name the database."
        )
    paths = files.images()
    if not paths:
        raise DriveError(f"{files.rgb} holds no images (.jpg or .png).")
    found: Mapping[Path, ExportedPose] = {}
    if files.poses is not None:
        require_within(files.poses, folder)
        found = read_poses(files.poses, paths)
    doubts: list[str] = []
    stamps = _known_stamps(paths, found, options, doubts)
    if missing := len(paths) - len(stamps):
        paths = [image for image in paths if image in stamps]
    paths = sorted(paths, key=stamps.__getitem__)
    track = _track(folder, files, {image: found[image] for image in paths if image in found}, stamps)
    if track is not None:
        doubts.append("The true poses are those of RTAB-Map's own map: useful for an evaluation, but not measured.")
    described = camera_beside(folder)
    return FileDrive(
        format="rtabmap",
        folder=folder,
        frames=[_listed_frame(folder, files, image, stamps[image], track) for image in paths],
        streams=_streams(files, paths, len(found), rate_hz([stamps[image] for image in paths])),
        camera=described.camera,
        depth_unit_m=described.metres_per_unit or MILLIMETRES,
        doubts=doubts,
        dropped={"without a pose": missing} if missing else {},
    )


EXPORT = FolderFormat(lambda path: ExportFiles.find(path) is not None, _listed_drive)
"""Folders that RTAB-Map exported."""


def _listed_frame(folder: Path, files: ExportFiles, image: Path, stamp: float, track: PoseTrack | None) -> ListedFrame:
    depth = _partner(files.depth, image)
    confidence = _partner(files.confidence, image)
    lens = files.lens_of(image)
    return ListedFrame(
        colour=str(image.relative_to(folder)),
        moment=FrameMoment.with_truth(stamp, None if track is None else track.at(stamp)),
        depth=None if depth is None else str(depth.relative_to(folder)),
        confidence=None if confidence is None else str(confidence.relative_to(folder)),
        lens=None if lens is None else partial(_described_lens, folder, lens),
    )


def _known_stamps(
    images: Sequence[Path], found: Mapping[Path, ExportedPose], options: ReadOptions, doubts: list[str]
) -> dict[Path, float]:
    """Return the stamps of the images: from the list of poses, else from the file names, else from the rate.

    With stamps from the list, images without a pose are left out, because their place is unknown.
    """
    listed = {image: pose.stamp for image, pose in found.items() if pose.stamp is not None}
    if listed and options.rate_hz is None:
        return listed
    try:
        if options.rate_hz is None and all("." in image.stem for image in images):
            return {image: float(image.stem) for image in images}
    except ValueError:
        pass  # Names with a point are not always numbers.
    if options.rate_hz is None:
        doubts.append(f"The images have no stamps; {RATE_HZ:g} per second are assumed; --rate sets another rate.")
    return {image: place / (options.rate_hz or RATE_HZ) for place, image in enumerate(images)}


def _track(
    folder: Path, files: ExportFiles, found: Mapping[Path, ExportedPose], stamps: Mapping[Path, float]
) -> PoseTrack | None:
    """Return the poses of the camera over time; None if no image has one. Raises DriveError."""
    if not found or files.poses is None:
        return None
    lens = files.lens_of(next(iter(found)))
    if lens is not None:
        require_within(lens, folder)
    matrices = camera_poses(
        np.stack([pose.pose for pose in found.values()]),
        are_of_camera=files.poses.name.endswith(_CAMERA_POSES),
        camera_on_robot=None if lens is None else CalibrationYaml(lens).transform("local_transform"),
    )
    times, rows = np.unique([stamps[image] for image in found], return_index=True)
    return PoseTrack(times, matrices[rows, :3, 3], Rotation.from_matrix(matrices[rows, :3, :3]))


def _streams(files: ExportFiles, images: Sequence[Path], poses: int, rate: float | None) -> list[SourceFact]:
    depths = sum(_partner(files.depth, image) is not None for image in images)
    streams = (
        SourceFact("rgb", files.rgb.name, len(images), rate),
        SourceFact("depth", "" if files.depth is None else files.depth.name, depths, rate),
        SourceFact("truth", "" if files.poses is None else files.poses.name, poses),
    )
    return [stream for stream in streams if stream.count]


def _described_lens(folder: Path, path: Path, width: int, height: int) -> CameraModel:
    """Return the lens in a file of OpenCV's FileStorage; without a size in the file, for images of the given size."""
    require_within(path, folder)
    said = CalibrationYaml(path)
    try:
        matrix = np.reshape(said.numbers("camera_matrix"), (3, 3)).tolist()
        size = (int(said.word("image_width") or 0) or width, int(said.word("image_height") or 0) or height)
    except ValueError as error:
        raise DriveError(
            f"{path} describes no camera ({error!s:.120}); it needs camera_matrix with 3 rows of 3 numbers. Correct "
            "it, or use --camera."
        ) from error
    distortion = tuple(said.numbers("distortion_coefficients"))
    is_fisheye = said.word("distortion_model") in _FISHEYES
    lens = FileLens(
        source=str(path),
        fx=matrix[0][0],
        fy=matrix[1][1],
        cx=matrix[0][2],
        cy=matrix[1][2],
        size=size,
        distortion=distortion[:4] if is_fisheye else distortion,
        fisheye=is_fisheye,
    )
    return lens.camera(width, height)
