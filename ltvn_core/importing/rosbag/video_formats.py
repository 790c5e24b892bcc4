"""What the format of a compressed image says of video: which codec, and whether it is depth."""

import re

_VIDEO = "video/"
"""Begins the format of messages that hold nothing but video."""
_CODECS = {
    "h264": re.compile(r"[hx]\.?264|avc"),
    "hevc": re.compile(r"[hx]\.?265|hevc"),
    "av1": re.compile(r"av1"),
    "vp9": re.compile(r"vp9"),
}
"""FFmpeg's name of a decoder -> how formats and encoders are called."""
_DEPTH = re.compile(r"gray1\d|16uc1|mono16|32fc1|64fc1|y16")
KNOWN = ", ".join(_CODECS)
"""Codecs that are read, for messages."""


def as_video(form: str) -> str:
    """Return the format of a compressed image for the encoding of a packet of video, whatever its codec."""
    return _VIDEO + form


def is_video(form: str) -> bool:
    """Tell whether a compressed image of this format is a packet of a video."""
    return form.startswith(_VIDEO) or video_codec(form) is not None


def video_codec(form: str) -> str | None:
    """Return FFmpeg's name of the decoder for a format, as `h264` for `libx264;yuv420p`; None where none is known."""
    codec = form.removeprefix(_VIDEO).lower().partition(";")[0]
    return next((name for name, pattern in _CODECS.items() if pattern.search(codec)), None)


def is_depth_video(form: str) -> bool:
    """Tell whether a video was made of depth images: behind the codec it names the formats of the pixels."""
    return is_video(form) and _DEPTH.search(form.lower().partition(";")[2]) is not None
