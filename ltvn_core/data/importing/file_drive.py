"""A drive as a list of files, with stamp, colours, depth and pose of each image, and the one class that reads them.

A format in a folder of files needs a function that returns such a list, and a test that recognises it.
"""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.image_files import ImageFilesReader
from ltvn_core.data.importing.pose_track import PicturePoses
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.spatial_pose import SpatialPose, Transform
from ltvn_core.data.importing.stamped_lists import RATE_HZ, rate_hz
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra
from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Depth, Pose, Rgb, Tilt

_NO_POSE = np.full((4, 4), np.nan)
OPTICAL_FROM_GRAPHICS = np.diag([1.0, -1.0, -1.0, 1.0])
"""Pose (4, 4) of the optical frame in the camera frame of OpenGL and ARKit (x right, y up, z backwards)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ListedFrame:
    """One image of a drive, before its files are read."""

    colour: str
    """Name of the file within the drive; a name in messages if the colours are a video."""
    stamp: float | None = None
    """Time in seconds; None if the format has no stamps."""
    depth: str | None = None
    confidence: str | None = None
    """Name of the confidence image of the depth image."""
    pose: Transform | None = None
    """Pose (4, 4) of the camera's optical frame in the world."""
    lens: FileLens | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FileDrive:
    """What the lists of a drive say."""

    frames: Sequence[ListedFrame]
    """Images in the order in which they were taken."""
    rgb: str
    """Name of the stream of colours."""
    video: Path | None = None
    """Video of the colours, one image for each frame; None if they are files."""
    poses: str = ""
    """Name of the file with the poses; empty without poses."""
    pose_role: str = "truth"
    """`odometry` for poses that drift, `truth` for those that were computed afterwards."""
    up_axis: str | None = None
    """Up axis of the world, as `PoseTrack` takes it."""
    depth_unit_m: float = MILLIMETRES
    doubts: Sequence[str] = ()
    unread: Sequence[SourceFact] = field(default_factory=tuple)
    """What lies in the source and is not read."""


class FileDriveReader(ImageFilesReader):
    """A drive that is open for reading, from the list of its files."""

    FORMAT: ClassVar[str]

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Read the lists, but no image yet. Raises DriveError."""
        super().__init__(folder, options)
        self._drive = self._listed()
        frames = self._drive.frames
        if not frames:
            raise DriveError(f"{folder} lists no images whose files exist; copy the whole folder.")
        self._check_options(options)
        self.doubts += self._drive.doubts
        stamps = [frame.stamp for frame in frames if frame.stamp is not None]
        has_stamps = len(stamps) == len(frames)
        if not has_stamps or options.rate_hz is not None:
            stamps = [place / (options.rate_hz or RATE_HZ) for place in range(len(frames))]
        self._stamps = stamps
        self._track = self._poses(frames) if options.odometry != NOTHING else None
        self._turns = self._quarter_turns()
        self.facts = DriveFacts(
            format=self.FORMAT,
            frames=len(frames),
            streams=self._streams(),
            place=folder.resolve().stem,
            assumed_rate_hz=None if has_stamps or options.rate_hz else RATE_HZ,
        )

    @abstractmethod
    def _listed(self) -> FileDrive:
        """Read the lists of the drive. Raises DriveError."""

    def _check_options(self, options: ReadOptions) -> None:
        for option, value in (("--rgb", options.rgb), ("--depth", options.depth), ("--odometry", options.odometry)):
            if value not in (None, NOTHING):
                raise DriveError(
                    f"{option} {value}: the files of a drive in the format {self.FORMAT} have fixed names; omit the "
                    "option, or import as another format with --format."
                )

    def _poses(self, frames: Sequence[ListedFrame]) -> PicturePoses | None:
        matrices = np.array([_NO_POSE if frame.pose is None else frame.pose for frame in frames])
        track = PicturePoses(matrices, self._drive.poses, up_axis=self._drive.up_axis)
        if len(track) and track.missing:
            self.doubts.append(f"{track.missing} images have no valid pose in {track.name}.")
        return track if len(track) else None

    def _quarter_turns(self) -> int:
        """Return the quarter turns that make the images upright by their poses; phones are held on their side."""
        if self._track is None or not (self._options.camera or any(frame.lens for frame in self._drive.frames)):
            return 0
        poses = (self._track.at(place) for place in range(len(self._drive.frames)))
        rolls = np.array([pose.tilt.roll_rad for pose in poses if pose is not None])
        usual = np.arctan2(np.sin(rolls).sum(), np.cos(rolls).sum())
        return round(-usual / (np.pi / 2)) % 4

    def _moment(self, stamp: float, seen: SpatialPose | None) -> FrameMoment:
        if seen is None:
            return FrameMoment(stamp)
        tilt = Tilt(seen.tilt.pitch_rad, float(wrap_angle(seen.tilt.roll_rad + self._turns * np.pi / 2)))
        is_odometry = self._drive.pose_role == "odometry"
        pose: Pose = seen.planar
        return FrameMoment(stamp, pose if is_odometry else None, None if is_odometry else pose, tilt)

    def _images(self) -> Iterator[tuple[FrameMoment, tuple[ListedFrame, Any]]]:
        for place, (frame, image) in enumerate(self._with_colours()):
            seen = None if self._track is None else self._track.at(place)
            yield self._moment(self._stamps[place], seen), (frame, image)

    def _with_colours(self) -> Iterator[tuple[ListedFrame, Any]]:
        """Yield each frame with its image of the video, if the colours are a video."""
        frames = self._drive.frames
        video = self._drive.video
        if video is None:
            yield from ((frame, None) for frame in frames)
            return
        with naming_the_extra():
            from ltvn_core.data.importing import video_frames
        images = video_frames.whole_video(video)
        for frame in frames:
            image = next(images, None)
            if image is None:
                self.doubts.append(f"{video.name} has fewer images than the {len(frames)} rows of {self._drive.poses}.")
                return
            yield frame, image.frame
        if next(images, None) is not None:
            self.doubts.append(f"{video.name} has more images than the {len(frames)} rows of {self._drive.poses}.")

    def _frame(self, moment: FrameMoment, image: tuple[ListedFrame, Any]) -> RawFrame:
        listed, picture = image
        rgb = self._colours(listed.colour) if picture is None else _colours_of(picture)
        depth_m = self._if_readable(lambda: self._read_depth(listed))
        return self._raw_frame(moment, listed.colour, rgb, camera=self._camera(listed, rgb), depth_m=depth_m)

    def _camera(self, listed: ListedFrame, rgb: Rgb) -> CameraModel | None:
        height, width = rgb.shape[:2]
        camera = self._options.camera or (None if listed.lens is None else listed.lens.camera(width, height))
        return replace(camera, quarter_turns=self._turns) if camera is not None and self._turns else camera

    def _read_depth(self, listed: ListedFrame) -> Depth | None:
        if listed.depth is None or self._options.depth == NOTHING:
            return None
        depth_m = self._depth_m(listed.depth, self._options.depth_unit_m or self._drive.depth_unit_m)
        return depth_m if listed.confidence is None else self._without_unsure(depth_m, listed.confidence)

    def _streams(self) -> Sequence[SourceFact]:
        drive = self._drive
        rate = rate_hz(self._stamps)
        streams = [SourceFact("rgb", drive.rgb, len(drive.frames), rate)]
        depths = [frame.depth for frame in drive.frames if frame.depth is not None]
        if depths and self._options.depth != NOTHING:
            streams.append(SourceFact("depth", depths[0].rpartition("/")[0] or depths[0], len(depths), rate))
        if self._track is not None:
            streams.append(SourceFact(drive.pose_role, drive.poses, len(self._track), rate))
        return (*streams, *drive.unread)


def _colours_of(picture: Any) -> Rgb:
    """Return the colours of an image of a video as it was taken, because depth and poses are of the camera, too."""
    from ltvn_core.data.importing import video_frames

    return video_frames.colours(picture)
