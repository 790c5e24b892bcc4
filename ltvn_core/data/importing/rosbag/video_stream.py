"""A video whose packets are messages of a bag: interprets the format of a message, and decodes packets (PyAV).

Owns which formats are video, and which are depth video. Owns the state between packets: images before the first key
frame, and from a damaged packet up to the next key frame, are left out, because they would be built on missing data. A
packet that was never recorded is detected in H.265, but not in H.264, where FFmpeg continues from the previous image.
"""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.data.importing.rosbag.image_matching import PendingImage
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra
from ltvn_core.types import Rgb

_VIDEO = "video/"
"""Prefix of the format of messages that contain only video."""
_CODECS = {
    "h264": re.compile(r"[hx]\.?264|avc"),
    "hevc": re.compile(r"[hx]\.?265|hevc"),
    "av1": re.compile(r"av1"),
    "vp9": re.compile(r"vp9"),
}
"""FFmpeg's decoder name -> pattern for the names of formats and encoders."""
_DEPTH = re.compile(r"gray1\d|16uc1|mono16|32fc1|64fc1|y16")
KNOWN = ", ".join(_CODECS)
"""Names of the supported codecs, for messages."""
BEFORE_KEY_FRAME = "no key frame of the video before it"
NO_PICTURE = "no image in the packet of the video"
DAMAGED = "damaged image"
_MOST_PIXELS = 35_651_584
"""Largest number of pixels of an image, the limit of the highest level of H.264 and H.265."""
_MOST_PENDING = 64
"""Largest number of packets whose image is not decoded yet; H.264 delays an image by at most 16."""
_START_CODE = b"\0\0\1"


def as_video(form: str) -> str:
    """Return the format of a compressed image that marks it as a video packet with the codec `form`."""
    return _VIDEO + form


def is_video(form: str) -> bool:
    """Tell whether a compressed image of this format is a packet of a video."""
    return form.startswith(_VIDEO) or video_codec(form) is not None


def video_codec(form: str) -> str | None:
    """Return FFmpeg's decoder name for a format, such as `h264` for `libx264;yuv420p`; None if it is unknown."""
    codec = form.removeprefix(_VIDEO).lower().partition(";")[0]
    return next((name for name, pattern in _CODECS.items() if pattern.search(codec)), None)


def is_depth_video(form: str) -> bool:
    """Tell whether a video was made of depth images, by the pixel formats after the codec's name."""
    return is_video(form) and _DEPTH.search(form.lower().partition(";")[2]) is not None


class VideoPicture(NamedTuple):
    """A decoded video image in place of an image message."""

    header: Any
    """Header of the message with the packet."""
    frame: Any
    """Frame of PyAV."""

    def colours(self) -> Rgb:
        """Return the colours (H, W, 3)."""
        return np.asarray(self.frame.to_ndarray(format="rgb24"), np.uint8)


class VideoStream:
    """Decodes the packets of one topic in the order of recording."""

    def __init__(self, topic: str, form: str, drop: Callable[[str], None]) -> None:
        """Open a decoder.

        Args:
            topic: Name of the video in messages.
            form: The format of its messages.
            drop: Called with the reason for each packet whose picture is not used.

        Raises:
            DriveError: The codec is not supported.
            MissingLibraryError: PyAV is not installed.
        """
        codec = video_codec(form)
        if codec is None:
            raise DriveError(
                f"{topic} is video in {form.partition('/')[2] or 'no named format'!r:.40}, which is not supported: "
                f"expected {KNOWN}. Choose other colours with --rgb."
            )
        with naming_the_extra():
            import av
        self._av = av
        self._drop = drop
        self._has_start_codes = codec in ("h264", "hevc")
        self._decoder: Any = av.CodecContext.create(codec, "r")
        # One packet gives one picture; threads would delay it, and take more memory.
        self._decoder.thread_count = 1
        self._decoder.options = {"max_pixels": str(_MOST_PIXELS)}
        self._pending: dict[int, PendingImage] = {}
        self._count = 0
        self._awaits_key = True
        self._has_key = False

    def pictures(self, image: PendingImage) -> list[PendingImage]:
        """Return the images that are complete after a packet; usually the image of this packet."""
        data = bytes(image.message.data)
        packet = self._av.Packet(data)
        packet.pts = self._count
        self._pending[self._count] = image
        self._count += 1
        try:
            # None would tell the decoder that the video has ended.
            found = self._decoder.decode(packet) if data else None
        except Exception:  # FFmpeg has a separate error for each kind of damage.
            found = None
        if found is None:
            is_foreign = self._has_start_codes and _START_CODE not in data
            self._forget(packet.pts, DAMAGED if self._has_key or is_foreign else BEFORE_KEY_FRAME)
            self._awaits_key = True
            return []
        if len(self._pending) > _MOST_PENDING:
            self._forget(next(iter(self._pending)), NO_PICTURE)
        return self._usable(found)

    def rest(self) -> list[PendingImage]:
        """Return the pictures that the decoder still holds at the end of the video."""
        try:
            found = self._usable(self._decoder.decode(None))
        except Exception:  # As above.
            found = []
        for pts in list(self._pending):
            self._forget(pts, NO_PICTURE if self._has_key else BEFORE_KEY_FRAME)
        return found

    def _usable(self, frames: Any) -> list[PendingImage]:
        """Return the undamaged frames, with the headers of their packets; a decoder may reorder them."""
        usable = []
        for frame in frames:
            image = self._pending.pop(frame.pts, None)
            if image is None:
                continue
            self._awaits_key = frame.is_corrupt or (self._awaits_key and not frame.key_frame)
            if self._awaits_key:
                self._drop(DAMAGED if self._has_key or frame.is_corrupt else BEFORE_KEY_FRAME)
                continue
            self._has_key = True
            picture = VideoPicture(image.message.header, frame)
            usable.append(image._replace(message=picture, size_bytes=frame.width * frame.height * 3))
        return usable

    def _forget(self, pts: int, reason: str) -> None:
        del self._pending[pts]
        self._drop(reason)
