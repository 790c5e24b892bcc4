"""A drive as a table of files, one row an image, and the one class that reads them.

A format of folders is a function that returns such a table, and a test that recognises a folder. `FolderFormat` joins
both, and an entry of `ltvn.readers` names it. Owns the treatment of damaged images, and the least confidence of a
phone's depth.
"""

import math
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.encoded_images import decode_colour, decode_depth
from ltvn_core.data.importing.file_lens import exif_camera
from ltvn_core.data.importing.foreign_files import MOST_IMAGE_BYTES, read_bytes_within
from ltvn_core.data.importing.pose_track import PicturePoses
from ltvn_core.data.importing.raw_frame import (
    NOTHING,
    DriveFacts,
    FrameFilter,
    FrameMoment,
    RawFrame,
    ReadOptions,
    SourceFact,
)
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.data.importing.stamped_lists import RATE_HZ, rate_hz
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra
from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Depth, Rgb, Tilt

DAMAGED = "damaged or missing image"
"""Reason for leaving out an image that cannot be read."""
_MOST_AT_FIRST = 1000
"""Number of damaged images at the start after which reading stops, because trying a million files takes minutes."""
_LARGEST_OF_THREE = 2
_ASPECT_TOLERANCE = 0.02
_LOW_PERCENT = 34
"""Confidence from 0 to 100 below which depth is discarded; if the levels are 0, 1 and 2, level 0 is discarded."""

NO_STAMP = FrameMoment(math.nan)
"""Moment of an image of a format that has no stamps."""
Lens: TypeAlias = Callable[[int, int], CameraModel | None]
"""Returns the camera of images of a width and height in pixels. Raises DriveError where it does not belong to them."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ListedFrame:
    """One image of a drive, before its files are read."""

    colour: str
    """Name of the file within the drive; a name in messages if the colours are a video."""
    moment: FrameMoment = NO_STAMP
    depth: str | None = None
    confidence: str | None = None
    """Name of the confidence image of the depth image."""
    lens: Lens | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FileDrive:
    """What the lists of a drive say."""

    format: str
    folder: Path
    """Folder of the files, or the archive that holds them."""
    frames: Sequence[ListedFrame]
    """Images in the order in which they were taken."""
    streams: Sequence[SourceFact]
    """What was found; the reader adds the stream of `poses`, if there are any."""
    unread: Sequence[SourceFact] = ()
    """What lies in the source and is not read."""
    place: str = ""
    """Default name of the drive; empty for the name of the folder."""
    camera: CameraModel | None = None
    """Camera of all images; the lens of a frame is used without it."""
    has_exif: bool = False
    """Whether the lens of an image is in its EXIF data, if it is nowhere else."""
    depth_unit_m: float = MILLIMETRES
    depth_focal_px: float | None = None
    """Focal length of depth images that are not registered to the colours, at the width of the camera."""
    poses: PicturePoses | None = None
    """Poses of the camera by the place of a frame, for formats with a matrix for each image."""
    pose_role: str = "truth"
    """`odometry` for `poses` that drift, `truth` for those that were computed afterwards."""
    has_fixed_names: bool = False
    """Whether no option chooses among the files. Phones write such drives, so the poses turn their images upright."""
    assumed_rate_hz: float | None = None
    """Number of images per second that was assumed, because they have no stamps."""
    archive: zipfile.ZipFile | None = None
    video: Path | None = None
    """Video of the colours, one image for each frame; None if they are files."""
    doubts: Sequence[str] = ()
    dropped: Mapping[str, int] = field(default_factory=dict)
    """Images that are not listed, by reason."""


@dataclass(frozen=True, slots=True)
class FolderFormat:
    """A format of folders; an entry of `ltvn.readers` names one."""

    is_folder_of: Callable[[Path], bool]
    """Tells by file names and first bytes whether a path looks like this format."""
    listed: Callable[[Path, ReadOptions], FileDrive]
    """Reads the lists of a drive, but no image. Raises DriveError."""

    def recognises(self, path: Path) -> bool:
        """Tell whether a path looks like this format; never raises."""
        try:
            return self.is_folder_of(path)
        except OSError:
            return False

    def open(self, path: Path, options: ReadOptions) -> "FileDriveReader":
        """Open a drive and read its lists, but no image yet. Raises DriveError."""
        return FileDriveReader(self.listed(path, options), options)


class ReadableDepths:
    """Reads depth images, and counts those that cannot be read, because their colour images are useful without."""

    def __init__(self) -> None:
        """Start before the first depth image."""
        self._faults: list[str] = []

    def __call__(self, read: Callable[[], Depth | None]) -> Depth | None:
        """Return the depth that `read` returns; None if it cannot be read."""
        try:
            return read()
        except DriveError as error:
            self._faults.append(str(error))
            return None

    @property
    def doubts(self) -> list[str]:
        """Return the doubt about the depth images that could not be read, if there are any."""
        if not self._faults:
            return []
        return [f"{len(self._faults)} depth images could not be read, so their images have no depth: {self._faults[0]}"]


class FileDriveReader:
    """A drive that is open for reading, from the table of its files. Implements `DriveReader` and `SelectiveReader`."""

    def __init__(self, drive: FileDrive, options: ReadOptions) -> None:
        """Take what the lists say, and the user's options. Raises DriveError where they do not fit."""
        if not drive.frames:
            raise DriveError(f"{drive.folder} lists no images whose files exist; copy the whole folder.")
        for option, value in (("--rgb", options.rgb), ("--depth", options.depth), ("--odometry", options.odometry)):
            if drive.has_fixed_names and value not in (None, NOTHING):
                raise DriveError(
                    f"{option} {value}: the files of a drive in the format {drive.format} have fixed names; omit the "
                    "option, or import as another format with --format."
                )
        self._drive = drive
        self._options = options
        self._if_readable = ReadableDepths()
        self.dropped = Counter(drive.dropped)
        """Number of images that were left out, by reason."""
        self.doubts = list(drive.doubts)
        """Doubts about the drive, as sentences."""
        stamps = [frame.moment.stamp for frame in drive.frames]
        assumed_hz = drive.assumed_rate_hz
        if any(map(math.isnan, stamps)) or (drive.has_fixed_names and options.rate_hz is not None):
            assumed_hz = None if options.rate_hz else RATE_HZ
            stamps = [place / (options.rate_hz or RATE_HZ) for place in range(len(drive.frames))]
        self._stamps = stamps
        self._poses = None if drive.has_fixed_names and options.odometry == NOTHING else drive.poses
        if self._poses is not None and self._poses.missing:
            self.doubts.append(f"{self._poses.missing} images have no valid pose in {self._poses.name}.")
        self._poses = self._poses or None  # Poses of which none is valid are no odometry.
        self._turns = self._quarter_turns() if drive.has_fixed_names else 0
        streams = [*drive.streams]
        if self._poses is not None:
            streams.append(SourceFact(drive.pose_role, self._poses.name, len(self._poses)))
        if drive.has_fixed_names:  # One stamp counts for all.
            streams = [replace(stream, rate_hz=rate_hz(self._stamps)) for stream in streams]
        self.facts = DriveFacts(
            format=drive.format,
            frames=len(drive.frames),
            streams=(*streams, *drive.unread),
            place=drive.place or (drive.folder.resolve().stem if drive.archive else drive.folder.resolve().name),
            assumed_rate_hz=assumed_hz,
        )
        """The facts of the drive."""

    def frames(self) -> Iterator[RawFrame]:
        """Yield all frames in order."""
        return self.frames_where(lambda _: True)

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames of the wanted moments; the images of other moments are not read.

        An image that cannot be read is counted, and the first such image is reported as a doubt. An image whose depth
        cannot be read comes without depth, which is a doubt too. Raises DriveError where the first 1000 images cannot
        be read.
        """
        found_any = False
        for place, (listed, picture) in enumerate(self._with_pictures()):
            moment = self._moment(place)
            if not wanted(moment):
                continue
            try:
                yield self._frame(moment, listed, picture)
                found_any = True
            except DriveError as error:
                if not self.dropped[DAMAGED]:
                    self.doubts.append(f"An image was left out: {error}")
                self.dropped[DAMAGED] += 1
                if not found_any and self.dropped[DAMAGED] >= _MOST_AT_FIRST:
                    raise DriveError(
                        f"None of the first {_MOST_AT_FIRST:,} images can be read. {self.doubts[-1]}"
                    ) from error
        self.doubts += self._if_readable.doubts

    def _quarter_turns(self) -> int:
        """Return the quarter turns that make the images upright by their poses; phones are held on their side."""
        frames = self._drive.frames
        if not self._poses or not (self._options.camera or any(frame.lens for frame in frames)):
            return 0
        poses = (self._poses.at(place) for place in range(len(frames)))
        rolls = np.array([pose.tilt.roll_rad for pose in poses if pose is not None])
        usual = np.arctan2(np.sin(rolls).sum(), np.cos(rolls).sum())
        return round(-usual / (np.pi / 2)) % 4

    def _moment(self, place: int) -> FrameMoment:
        moment = self._drive.frames[place].moment._replace(stamp=self._stamps[place])
        seen = None if self._poses is None else self._poses.at(place)
        if seen is None:
            return moment
        tilt = seen.tilt
        if self._turns:
            tilt = Tilt(tilt.pitch_rad, float(wrap_angle(tilt.roll_rad + self._turns * np.pi / 2)))
        return moment._replace(**{self._drive.pose_role: seen.planar}, tilt=tilt)

    def _with_pictures(self) -> Iterator[tuple[ListedFrame, Any]]:
        """Yield each frame with its image of the video, if the colours are a video."""
        frames, video = self._drive.frames, self._drive.video
        if video is None:
            yield from ((frame, None) for frame in frames)
            return
        with naming_the_extra():
            from ltvn_core.data.importing import video_frames
        images = video_frames.whole_video(video)
        for count, frame in enumerate(frames):
            image = next(images, None)
            if image is None:
                self.doubts.append(f"{video.name} has only {count} images for {len(frames)} rows of the list.")
                return
            yield frame, video_frames.colours(image.frame)
        if next(images, None) is not None:
            self.doubts.append(f"{video.name} has more images than the {len(frames)} rows of the list.")

    def _frame(self, moment: FrameMoment, listed: ListedFrame, picture: Rgb | None) -> RawFrame:
        """Read one image. Raises DriveError if it cannot be read, or the camera does not fit."""
        blob = b"" if picture is not None else self._bytes(listed.colour)
        rgb = decode_colour(blob, listed.colour) if picture is None else picture
        height, width = rgb.shape[:2]
        depth_m = self._if_readable(lambda: self._depth_m(listed))
        camera = self._options.camera or self._drive.camera
        if camera is None and listed.lens is not None:
            camera = listed.lens(width, height)
        elif camera is None and self._drive.has_exif:
            camera = exif_camera(blob, width, height)
        if camera is not None and self._turns:
            camera = replace(camera, quarter_turns=self._turns)
        depth_camera, focal = None, self._drive.depth_focal_px
        if focal is not None and camera is not None and depth_m is not None:
            high, wide = depth_m.shape
            focal *= wide / camera.width
            depth_camera = CameraModel(
                width=wide, height=high, fx=focal, fy=focal, cx=(wide - 1) / 2, cy=(high - 1) / 2
            )
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            depth_m=depth_m,
            camera=None if camera is None else fitted(camera, width, height, listed.colour),
            depth_camera=depth_camera,
            odometry=moment.odometry,
            truth=moment.truth,
            tilt=moment.tilt,
            name=listed.colour,
        )

    def _depth_m(self, listed: ListedFrame) -> Depth | None:
        if listed.depth is None or self._options.depth == NOTHING:
            return None
        unit_m = self._options.depth_unit_m or self._drive.depth_unit_m
        depth_m = decode_depth(self._bytes(listed.depth), unit_m, listed.depth)
        if listed.confidence is None:
            return depth_m
        levels = decode_colour(self._bytes(listed.confidence), listed.confidence)[..., 0]
        return without_low_confidence(depth_m, levels)

    def _bytes(self, name: str) -> bytes:
        """Return the bytes of a file of the drive. Raises DriveError."""
        if self._drive.archive is None:
            return read_bytes_within(self._drive.folder, name)
        return archived_bytes(self._drive.archive, name)


def archived_bytes(archive: zipfile.ZipFile, name: str) -> bytes:
    """Return the bytes of an image in a ZIP archive. Raises DriveError for a missing, damaged or too large file."""
    try:
        if archive.getinfo(name).file_size > MOST_IMAGE_BYTES:
            raise DriveError(f"{name} in {archive.filename} is too large for a file of a phone.")
        return archive.read(name)
    except (KeyError, OSError, RuntimeError, zipfile.BadZipFile, NotImplementedError) as error:
        raise DriveError(f"{name} cannot be read from {archive.filename} ({error!s:.120}).") from error


def without_low_confidence(depth_m: Depth, levels: NDArray[np.uint8]) -> Depth:
    """Return depth (H, W) with 0 (no return) where its confidence levels, perhaps at another size, are low.

    Raises DriveError where their aspect ratios differ.
    """
    if levels.shape != depth_m.shape:
        sizes = [f"{each.shape[1]} x {each.shape[0]}" for each in (levels, depth_m)]
        if abs(levels.shape[1] * depth_m.shape[0] / (levels.shape[0] * depth_m.shape[1]) - 1) > _ASPECT_TOLERANCE:
            raise DriveError(
                f"A confidence image has {sizes[0]} pixels and its depth image {sizes[1]}; save both in one size, or "
                "move the confidence images away."
            )
        levels = np.asarray(cv2.resize(levels, depth_m.shape[::-1], interpolation=cv2.INTER_NEAREST), np.uint8)
    is_low = levels == 0 if levels.max(initial=0) <= _LARGEST_OF_THREE else levels < _LOW_PERCENT
    return np.where(is_low, 0, depth_m).astype(np.float32)


def listed_streams(frames: Sequence[ListedFrame], rgb: str, options: ReadOptions) -> list[SourceFact]:
    """Return the streams of colours and depth of a list of images; `rgb` is the name of the colours."""
    streams = [SourceFact("rgb", rgb, len(frames))]
    depths = [frame.depth for frame in frames if frame.depth is not None]
    if depths and options.depth != NOTHING:
        streams.append(SourceFact("depth", depths[0].rpartition("/")[0] or depths[0], len(depths)))
    return streams
