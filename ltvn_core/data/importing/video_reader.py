"""Reads a video as a drive: the colours of its images with their times, rotated upright."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from ltvn_core.data.importing.foreign_files import require_plain
from ltvn_core.data.importing.raw_frame import DriveFacts, FrameFilter, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.data.importing.stamped_lists import OdometryTable
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra

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
        self._camera = options.camera
        self._rate_hz = options.rate_hz
        self._table = None if options.odometry is None else OdometryTable.read(Path(options.odometry))
        self.dropped: Counter[str] = Counter()
        self.doubts: list[str] = []
        try:
            require_plain(path)
        except OSError as error:
            raise DriveError(f"{path} cannot be read ({error!s:.120}).") from error
        found = video_frames.video_facts(path, self._container)
        streams = [SourceFact("rgb", path.name, found.images, self._rate_hz or found.rate_hz)]
        if self._table is not None:
            self.doubts += self._table.doubts
            streams.append(SourceFact("odometry", self._table.name, len(self._table), None))
        self.facts = DriveFacts(format="video", frames=found.images, streams=streams, place=path.stem)

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
        part = self._decoding.VideoPart(self._path, 0.0, math.inf)
        images = self._decoding.video_images(part, _ANY_S, container_format=self._container)
        place = -1
        try:
            for place, image in enumerate(images):
                stamp = image.stamp if self._rate_hz is None else place / self._rate_hz
                moment = FrameMoment(stamp, None if self._table is None else self._table.pose("", stamp))
                if wanted(moment):
                    yield self._frame(moment, image.frame, place)
        except DriveError as error:
            if place < 0:
                raise
            self.doubts.append(f"After {place + 1} images the rest of the video cannot be read: {error}")

    def _frame(self, moment: FrameMoment, frame: object, place: int) -> RawFrame:
        rgb = self._decoding.upright_colours(frame)
        height, width = rgb.shape[:2]
        name = f"image {place} of {self._path.name}"
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            camera=None if self._camera is None else fitted(self._camera, width, height, name),
            odometry=moment.odometry,
            name=name,
        )
