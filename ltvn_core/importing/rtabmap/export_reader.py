"""Reads what `rtabmap-export --images --poses_camera` and RTAB-Map on a phone write: images, depth, lens and poses.

Depth has fewer pixels than the colours and shows the same; where its confidence is low there is none.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.encoded_images import decode_colour, decode_depth
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.importing.calibration_yaml import CalibrationYaml
from ltvn_core.importing.depth_confidence import without_low_confidence
from ltvn_core.importing.foreign_files import read_bytes_within, require_within
from ltvn_core.importing.pose_track import PoseTrack
from ltvn_core.importing.raw_frame import DriveFacts, FrameFilter, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.importing.readable_frames import readable_frames
from ltvn_core.importing.rtabmap.export_files import ExportedPose, ExportFiles, camera_poses, read_poses
from ltvn_core.importing.source_camera import camera_beside, fitted
from ltvn_core.importing.stamp_matching import rate_hz
from ltvn_core.types import Depth

RATE_HZ = 1.0
"""RTAB-Map keeps an image a second, where nobody says otherwise."""

_NO_DEPTH = "none"
_FISHEYES = ("equidistant", "fisheye")


class RtabmapExportReader:
    """An export of RTAB-Map that is open for reading."""

    def __init__(self, files: ExportFiles, options: ReadOptions) -> None:
        """Read the list of poses, and no image yet. Raises DriveError."""
        self._files, self._options = files, options
        self._folder = files.folder
        self._images = list(files.images())
        if not self._images:
            raise DriveError(f"{files.rgb} holds no images (.jpg or .png).")
        self._described = camera_beside(self._folder)
        self.dropped: Counter[str] = Counter()
        self.doubts: list[str] = []
        found = {} if files.poses is None else read_poses(self._within(files.poses), self._images)
        self._stamps = self._known_stamps(found)
        self._images.sort(key=self._stamps.__getitem__)
        self._truth = self._track(found) if found else None
        self.facts = DriveFacts(
            format="rtabmap",
            frames=len(self._images),
            streams=self._streams(len(found)),
            place=self._folder.resolve().name,
        )

    def frames(self) -> Iterator[RawFrame]:
        """Yield the images in the order of their stamps, with depth and poses."""
        return self.frames_where(lambda _: True)

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames without those whose moment is not wanted, whose images are not read."""
        truth, stamps = self._truth, self._stamps
        images = (
            (FrameMoment.with_truth(stamps[image], None if truth is None else truth.at(stamps[image])), image)
            for image in self._images
        )
        return readable_frames(images, self._frame, wanted, dropped=self.dropped, doubts=self.doubts)

    def _frame(self, moment: FrameMoment, image: Path) -> RawFrame:
        name = str(image.relative_to(self._folder))
        rgb = decode_colour(read_bytes_within(self._folder, name), name)
        height, width = rgb.shape[:2]
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            depth_m=self._depth(image),
            camera=self._lens(image, width, height),
            truth=moment.truth,
            tilt=moment.tilt,
            name=name,
        )

    def _lens(self, image: Path, width: int, height: int) -> CameraModel | None:
        said = self._options.camera or self._described.camera
        path = self._files.lens_of(image)
        if said is None and path is not None:
            said = _described_lens(self._within(path), width, height)
        return None if said is None else fitted(said, width, height, image.name)

    def _depth(self, image: Path) -> Depth | None:
        path = None if self._options.depth == _NO_DEPTH else self._files.depth_of(image)
        if path is None:
            return None
        name = str(path.relative_to(self._folder))
        unit_m = self._options.depth_unit_m or self._described.metres_per_unit or MILLIMETRES
        depth = decode_depth(read_bytes_within(self._folder, name), unit_m, name)
        confidence = self._files.confidence_of(image)
        return depth if confidence is None else self._trusted(depth, str(confidence.relative_to(self._folder)))

    def _trusted(self, depth: Depth, name: str) -> Depth:
        """Return depth (h, w) without what the confidence image of that name calls low."""
        levels = decode_colour(read_bytes_within(self._folder, name), name)[..., 0]
        if levels.shape != depth.shape:
            size = (depth.shape[1], depth.shape[0])
            levels = np.asarray(cv2.resize(levels, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        return without_low_confidence(depth, levels)

    def _known_stamps(self, found: Mapping[Path, ExportedPose]) -> dict[Path, float]:
        """Return the stamps of the images: from the list of poses, from their names, else by the rate."""
        listed = {image: pose.stamp for image, pose in found.items() if pose.stamp is not None}
        if listed and self._options.rate_hz is None:
            # An image without a pose lies between its neighbours; it is left out as one whose place nobody knows.
            missing = [image for image in self._images if image not in listed]
            if missing:
                self.dropped["without a pose"] = len(missing)
                self._images = [image for image in self._images if image in listed]
            return listed
        try:
            if self._options.rate_hz is None and all("." in image.stem for image in self._images):
                return {image: float(image.stem) for image in self._images}
        except ValueError:
            pass  # Names with a point need not be numbers.
        rate = self._options.rate_hz or RATE_HZ
        if self._options.rate_hz is None:
            self.doubts.append(f"The images have no stamps; {RATE_HZ:g} a second is assumed, --rate says it.")
        return {image: place / rate for place, image in enumerate(self._images)}

    def _track(self, found: Mapping[Path, ExportedPose]) -> PoseTrack:
        images = [image for image in self._images if image in found]
        matrices = np.stack([found[image].pose for image in images])
        of_camera = self._files.poses is not None and self._files.poses.name.endswith("camera_poses.txt")
        lens = self._files.lens_of(images[0])
        on_robot = None if lens is None else CalibrationYaml(self._within(lens)).transform("local_transform")
        matrices = camera_poses(matrices, are_of_camera=of_camera, camera_on_robot=on_robot)
        stamps, rows = np.unique([self._stamps[image] for image in images], return_index=True)
        self.doubts.append("True poses are those of RTAB-Map's own map: good to judge by, but no measurement.")
        return PoseTrack(stamps, matrices[rows, :3, 3], Rotation.from_matrix(matrices[rows, :3, :3]))

    def _streams(self, poses: int) -> list[SourceFact]:
        rate = rate_hz([self._stamps[image] for image in self._images])
        depths = sum(self._files.depth_of(image) is not None for image in self._images)
        poses_name = "" if self._files.poses is None else self._files.poses.name
        streams = (
            SourceFact("rgb", self._files.rgb.name, len(self._images), rate),
            SourceFact("depth", "" if self._files.depth is None else self._files.depth.name, depths, rate),
            SourceFact("truth", poses_name, poses),
        )
        return [stream for stream in streams if stream.count]

    def _within(self, path: Path) -> Path:
        require_within(path, self._folder)
        return path


def _described_lens(path: Path, width: int, height: int) -> CameraModel:
    """Return the lens that OpenCV's FileStorage describes, for images of a size where it names none."""
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
            f"{path} describes no camera ({error!s:.120}); it needs camera_matrix with 3 rows of 3 numbers. Mend it, "
            "or use --camera."
        ) from error
