"""The images of a part of a video, decoded one after the other by PyAV when they are requested.

Owns the limits: a file has only the named format, refers to no other file, and its images are not larger than those of
a camera.
"""

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.encoded_images import MAX_PIXELS
from ltvn_core.errors import DriveError
from ltvn_core.types import Rgb

_MOST_IMAGES = 2_000_000
"""Largest number of images: eighteen hours at 30 images per second."""
_PART_HEADER = struct.Struct(">I4s")
"""Length of a part of an MP4 file, including this header, and its kind."""
_DEEP = {"gray12le", "gray16le", "gray16be", "gray10le", "yuv420p12le", "yuv422p12le", "yuv444p12le"}


class VideoPart(NamedTuple):
    """A part of a video file."""

    path: Path
    begin_s: float
    end_s: float
    track: int = 0
    """Index among the video tracks of the file."""


class VideoImage(NamedTuple):
    """A decoded image."""

    stamp: float
    """Time in seconds since the beginning of the part."""
    frame: Any
    """Frame of PyAV, for `colours` and `codes`."""


class VideoTrack(NamedTuple):
    """Facts about a track of images, known before decoding; None for missing ones."""

    name: str
    """Title of the track; `track N` without one."""
    width: int
    height: int
    pixels: str
    """FFmpeg's name of the pixel format."""
    images: int | None
    rate_hz: float | None

    @property
    def is_deep(self) -> bool:
        """Whether it has one channel of more than 8 bits."""
        return self.pixels.startswith("gray") and self.pixels in _DEEP

    @classmethod
    def of(cls, stream: Any, place: int) -> "VideoTrack":
        """Describe a stream of PyAV."""
        return cls(
            name=str(stream.metadata.get("title") or f"track {place}"),
            width=stream.codec_context.width,
            height=stream.codec_context.height,
            pixels=str(stream.codec_context.pix_fmt or "unknown pixels"),
            images=stream.frames or None,
            rate_hz=float(stream.average_rate) if stream.average_rate else None,
        )


def video_tracks(path: Path, container_format: str) -> list[VideoTrack]:
    """Return the tracks of images of a video, at least one. Raises DriveError like `video_images`."""
    try:
        with path.open("rb") as file, av.open(file, mode="r", format=container_format) as container:
            if not container.streams.video:
                raise DriveError(f"{path} contains no images, but {len(container.streams)} other streams.")
            return [VideoTrack.of(stream, place) for place, stream in enumerate(container.streams.video)]
    except DriveError:
        raise
    except Exception as error:  # As below.
        if container_format == "mp4" and not _has_index(path):
            raise DriveError(
                f"{path} has no index (the `moov` part), so its images cannot be found: its recording or copying was "
                "interrupted. Copy the whole file again; if the original lacks it too, a program such as untrunc can "
                "rebuild it from another video of the same camera. Record as .mkv to lose only the end next time."
            ) from error
        raise _unreadable(path, error) from error


def _has_index(path: Path) -> bool:
    """Tell whether an MP4 file has the part that says where its images are; its parts follow each other by length."""
    with path.open("rb") as file:
        size = path.stat().st_size
        position = 0
        while position + _PART_HEADER.size <= size:
            file.seek(position)
            length, kind = _PART_HEADER.unpack(file.read(_PART_HEADER.size))
            if kind == b"moov":
                return position + length <= size
            if length == 1:  # The length of a large part follows in 64 bits.
                length = int.from_bytes(file.read(8), "big")
            if length < _PART_HEADER.size:
                return False
            position += length
    return False


def video_images(part: VideoPart, period_s: float, *, container_format: str = "mp4") -> Iterator[VideoImage]:
    """Yield the images of a part. Raises DriveError where the file is damaged, foreign, or too large."""
    try:
        # With a file object and a named format, PyAV opens nothing else, whatever the file refers to.
        with part.path.open("rb") as file, av.open(file, mode="r", format=container_format) as container:
            stream = container.streams.video[part.track]
            _check_size(stream.codec_context.width, stream.codec_context.height, part.path)
            stream.codec_context.options = {"max_pixels": str(MAX_PIXELS)}
            if part.begin_s > 0 and stream.time_base:
                container.seek(int(part.begin_s / stream.time_base), stream=stream)
            for count, frame in enumerate(container.decode(stream)):
                time = float(frame.time or 0.0)
                if time > part.end_s - period_s / 2 or count > _MOST_IMAGES:
                    return
                _check_size(frame.width, frame.height, part.path)
                if time > part.begin_s - period_s / 2:
                    yield VideoImage(time - part.begin_s, frame)
    except DriveError:
        raise
    except Exception as error:  # FFmpeg has a separate error for each kind of damage.
        raise _unreadable(part.path, error) from error


def whole_video(path: Path) -> Iterator[VideoImage]:
    """Yield all images of an MP4 file. Raises DriveError like `video_images`."""
    return video_images(VideoPart(path, 0.0, math.inf), 1e-6)


def _unreadable(path: Path, error: Exception) -> DriveError:
    return DriveError(f"{path} is not a video that can be read ({' '.join(str(error).split())!s:.120}).")


def colours(frame: Any) -> Rgb:
    """Return the colours (H, W, 3) of a decoded image."""
    return np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)


def upright_colours(frame: Any) -> Rgb:
    """Return the colours of a decoded image, rotated upright by the video's metadata, because phones may record
    sideways."""
    return np.ascontiguousarray(np.rot90(colours(frame), round((frame.rotation or 0) / 90)))


def codes(frame: Any, path: Path) -> NDArray[np.uint16]:
    """Return the brightness (H, W) of a decoded image in full bit depth. Raises DriveError if it has only eight
    bits."""
    if frame.format.name not in _DEEP:
        raise DriveError(f"{path}: depth in {frame.format.name} has too few bits; expected {', '.join(sorted(_DEEP))}.")
    plane = frame.planes[0]
    # A conversion by PyAV would stretch the values.
    lines = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: frame.height, : 2 * frame.width]
    return np.ascontiguousarray(lines).view(">u2" if frame.format.name.endswith("be") else "<u2").astype(np.uint16)


def _check_size(width: int, height: int, path: Path) -> None:
    if not 0 < width * height <= MAX_PIXELS:
        raise DriveError(f"{path} has images of {width} x {height}, which is not a size of a robot's camera.")
