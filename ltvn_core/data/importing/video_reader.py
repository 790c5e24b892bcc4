"""Reads a video as a drive: the colours of its images with their times, rotated upright, and the depth of a track of
its own.

Recorders of depth cameras such as k4arecorder write colours, depth and infrared as three tracks of one file.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.cameras.encoded_images import NO_RETURN
from ltvn_core.data.importing.foreign_files import require_plain
from ltvn_core.data.importing.raw_frame import (
    NOTHING,
    DriveFacts,
    FrameFilter,
    FrameMoment,
    RawFrame,
    ReadOptions,
    SourceFact,
)
from ltvn_core.data.importing.reader_registry import LAST, recognised_format
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.data.importing.stamped_lists import OdometryTable
from ltvn_core.data.importing.unread_files import require_file, unread_beside
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra

if TYPE_CHECKING:
    from ltvn_core.data.importing.video_frames import VideoTrack

_CONTAINERS = {
    ".mp4": "mp4",
    ".m4v": "mp4",
    ".mov": "mp4",
    ".3gp": "mp4",
    ".mkv": "matroska",
    ".webm": "matroska",
    ".avi": "avi",
}
"""Ending of a file -> FFmpeg's name of the format."""
_BEGINNINGS = {
    "mp4": (4, (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")),
    "matroska": (0, (b"\x1aE\xdf\xa3",)),
    "avi": (8, (b"AVI ",)),
}
"""Position of the magic bytes in each format, and their possible values."""
_DEPTH_NAME = re.compile(r"depth", re.IGNORECASE)
_NO_DEPTH_NAME = re.compile(r"(^|[^a-z])ir([^a-z]|$)|infra", re.IGNORECASE)
_ASPECT_TOLERANCE = 0.02
_SLACK_S = 0.05
"""Largest time between colours and depth of one moment, in seconds."""
_ANY_S = 1e-6
"""Period in seconds that selects every image; shorter than that of any camera."""


class VideoReader:
    """A video that is open for reading."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        """Open the video. Raises DriveError, and MissingLibraryError if the library for videos is missing."""
        with naming_the_extra():
            from ltvn_core.data.importing import video_frames
        self._decoding = video_frames
        self._path = path
        self._container = _CONTAINERS.get(path.suffix.lower(), "mp4")
        self._options = options
        self._table = None
        if options.odometry not in (None, NOTHING):
            require_file(Path(options.odometry), "--odometry", "odometry")
            self._table = OdometryTable.read(Path(options.odometry))
        self.dropped: Counter[str] = Counter()
        self.doubts: list[str] = []
        try:
            require_plain(path)
        except OSError as error:
            raise DriveError(f"{path} cannot be read ({error!s:.120}).") from error
        tracks = video_frames.video_tracks(path, self._container)
        # By default the first track that is neither depth nor infrared.
        usual = (
            place
            for place, track in enumerate(tracks)
            if not (track.is_deep or _DEPTH_NAME.search(track.name) or _NO_DEPTH_NAME.search(track.name))
        )
        self._colours = next(usual, 0) if options.rgb is None else _named(tracks, options.rgb, "--rgb")
        self._depth = _depth_track(tracks, self._colours, options.depth)
        self.doubts += [] if self._table is None else self._table.doubts
        self.facts = DriveFacts(
            format="video", frames=tracks[self._colours].images, streams=self._streams(tracks), place=path.stem
        )

    def _streams(self, tracks: Sequence["VideoTrack"]) -> list[SourceFact]:
        """Return the tracks, the table of odometry, and what lies beside the video."""
        colours = tracks[self._colours]
        name = self._path.name if len(tracks) == 1 else colours.name
        streams = [SourceFact("rgb", name, colours.images, self._options.rate_hz or colours.rate_hz)]
        for place, track in enumerate(tracks):
            if place == self._depth:
                streams.append(SourceFact("depth", track.name, track.images, track.rate_hz))
            elif place != self._colours:
                streams.append(_unread(track, colours))
        if self._table is not None:
            streams.append(SourceFact("odometry", self._table.name, len(self._table), None))
        folder = self._path.parent
        is_drive = recognised_format(folder) not in (None, LAST)
        remedy = f"Import the folder {folder}, if they belong to this video." if is_drive else ""
        return [*streams, *unread_beside(folder, (self._path.name,), remedy=remedy)]

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell by its ending and its first bytes whether a path is a video; never raises."""
        container = _CONTAINERS.get(path.suffix.lower())
        try:
            if container is None or not path.is_file():
                return False
            place, marks = _BEGINNINGS[container]
            with path.open("rb") as file:
                return file.read(12)[place:].startswith(marks)
        except OSError:
            return False

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> Self:
        """Open a video. Raises DriveError, and MissingLibraryError if the library for videos is missing."""
        return cls(path, options)

    def frames(self) -> Iterator[RawFrame]:
        """Yield the images with their times since the beginning. Raises DriveError where none can be read."""
        return self.frames_where(lambda _: True)

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames of the wanted moments; the colours of other moments are not converted."""
        place = -1
        depths = None if self._depth is None else _NearestImages(self._images(self._depth))
        try:
            for place, image in enumerate(self._images(self._colours)):
                rate_hz = self._options.rate_hz
                stamp = image.stamp if rate_hz is None else place / rate_hz
                moment = FrameMoment(stamp, None if self._table is None else self._table.pose("", stamp))
                depth = None if depths is None else depths.at(image.stamp)
                if wanted(moment):
                    yield self._frame(moment, image.frame, place, depth)
        except DriveError as error:
            if place < 0:
                raise
            self.doubts.append(f"After {place + 1} images the rest of the video cannot be read: {error}")
        if depths is not None and depths.fault:
            self.doubts.append(f"The rest of the depth track cannot be read: {depths.fault}")

    def _images(self, track: int) -> Iterator[Any]:
        part = self._decoding.VideoPart(self._path, 0.0, math.inf, track)
        return self._decoding.video_images(part, _ANY_S, container_format=self._container)

    def _frame(self, moment: FrameMoment, frame: object, place: int, depth: Any) -> RawFrame:
        rgb = self._decoding.upright_colours(frame)
        height, width = rgb.shape[:2]
        name = f"image {place} of {self._path.name}"
        camera = self._options.camera
        depth_m = None
        if depth is not None:
            codes = self._decoding.codes(depth, self._path)
            unit_m = self._options.depth_unit_m or MILLIMETRES
            metres = np.where(codes == NO_RETURN, 0, codes).astype(np.float32) * np.float32(unit_m)
            depth_m = np.ascontiguousarray(np.rot90(metres, round((depth.rotation or 0) / 90)))
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            depth_m=depth_m,
            camera=None if camera is None else fitted(camera, width, height, name),
            odometry=moment.odometry,
            name=name,
        )


class _NearestImages:
    """The images of a track by their times, read on in step with those of another track."""

    def __init__(self, images: Iterator[Any]) -> None:
        self._images = images
        self._held: list[Any] = []
        self.fault = ""
        """Why the rest of the track cannot be read; empty if it can."""

    def at(self, stamp: float) -> Any:
        """Return the frame nearest to a time; None if there is none within `_SLACK_S`."""
        while not self._held or self._held[-1].stamp < stamp:
            try:
                self._held.append(next(self._images))
            except StopIteration:
                break
            except DriveError as error:
                self.fault = str(error)
                break
        self._held = self._held[-2:]
        nearest = min(self._held, key=lambda image: abs(image.stamp - stamp), default=None)
        return nearest.frame if nearest is not None and abs(nearest.stamp - stamp) <= _SLACK_S else None


def _depth_track(tracks: Sequence["VideoTrack"], colours: int, wanted: str | None) -> int | None:
    """Return the index of the named track, or of the only usable one that is called depth. Raises DriveError."""
    if wanted == NOTHING:
        return None
    if wanted is not None:
        return _named(tracks, wanted, "--depth")
    usable = [
        place
        for place, track in enumerate(tracks)
        if place != colours and track.is_deep and _DEPTH_NAME.search(track.name) and _covers(track, tracks[colours])
    ]
    return usable[0] if len(usable) == 1 else None


def _named(tracks: Sequence["VideoTrack"], wanted: str, option: str) -> int:
    names = [track.name for track in tracks]
    if wanted not in names:
        raise DriveError(f"The video has no track {wanted} for {option}; it may be {', '.join(names)}.")
    return names.index(wanted)


def _covers(depth: "VideoTrack", colours: "VideoTrack") -> bool:
    """Tell whether depth can be registered to the colours: its images have their aspect ratio."""
    return abs(depth.width * colours.height / (depth.height * colours.width) - 1) < _ASPECT_TOLERANCE


def _unread(track: "VideoTrack", colours: "VideoTrack") -> SourceFact:
    """Describe a track that is not read, and how it could be used as depth."""
    kind = f"{track.pixels}, {track.width} x {track.height}"
    is_called_depth = _DEPTH_NAME.search(track.name) is not None
    if _NO_DEPTH_NAME.search(track.name) or not (track.is_deep or is_called_depth):
        return SourceFact("", track.name, track.images, track.rate_hz, kind=kind)
    remedy = ""
    if not track.is_deep:
        remedy = f"{track.name} is written as {track.pixels}, not as 16-bit grey: write gray16le or gray16be."
    elif not _covers(track, colours):
        remedy = (
            f"{track.name} has another aspect ratio than {colours.name}, so it must be aligned with the colours first: "
            "Open3D's azure_kinect_mkv_reader writes the folders color and depth, which `ltvn import` reads."
        )
    return SourceFact("", track.name, track.images, track.rate_hz, could_be="depth", kind=kind, remedy=remedy)
