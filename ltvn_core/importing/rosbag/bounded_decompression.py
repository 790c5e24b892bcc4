"""Decompression that stops at a limit, put into the library `rosbags`, which has none: a kilobyte may claim a terabyte.

Owns the limits. What is decompressed is as large as the file says, and never larger than `MAX_CHUNK_BYTES`.
"""

import bz2
import io
from typing import BinaryIO, Protocol, cast

import lz4.frame
from backports import zstd
from rosbags.rosbag1 import reader as rosbag1_reader
from rosbags.rosbag2 import storage_mcap

from ltvn_core.errors import DriveError

MAX_CHUNK_BYTES = 2**28
"""Chunks of bags have about a megabyte, and must hold an image; 256 MB is 60 megapixels of raw colours."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""A message that was compressed by itself begins so; one that was not begins with a zero."""


class _Opener(Protocol):
    def __call__(self, file: BinaryIO, /) -> object: ...


def bound_decompression() -> None:
    """Have `rosbags` decompress no more than a chunk says it holds, and no chunk of more than `MAX_CHUNK_BYTES`."""
    storage_mcap.DECOMPRESSORS.update(
        lz4=lambda data, size: _declared(lz4.frame.LZ4FrameFile, data, size),
        zstd=lambda data, size: _declared(zstd.ZstdFile, data, size),
    )
    rosbag1_reader.decompressors.update(
        lz4=lambda data: _limited(lz4.frame.LZ4FrameFile, data), bz2=lambda data: _limited(bz2.BZ2File, data)
    )


def decompress_message(data: bytes) -> bytes:
    """Return a message of a bag that compresses each by itself. Raises DriveError where it is too large."""
    return _limited(zstd.ZstdFile, data)


def _declared(opener: _Opener, data: bytes, size: int) -> bytes:
    if size > MAX_CHUNK_BYTES:
        raise _too_large(f"{size:,} bytes")
    # One more byte than declared, so that the library notices a lie.
    return _read(opener, data, size + 1)


def _limited(opener: _Opener, data: bytes) -> bytes:
    raw = _read(opener, data, MAX_CHUNK_BYTES + 1)
    if len(raw) > MAX_CHUNK_BYTES:
        raise _too_large("more")
    return raw


def _read(opener: _Opener, data: bytes, most: int) -> bytes:
    with cast(BinaryIO, opener(io.BytesIO(data))) as stream:
        return stream.read(most)


def _too_large(size: str) -> DriveError:
    return DriveError(
        f"A compressed part of the bag unpacks to {size}, where {MAX_CHUNK_BYTES:,} bytes are the most that is "
        "read at once; write the bag again with smaller chunks, for instance with `ros2 bag convert`."
    )
