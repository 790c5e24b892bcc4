"""Depth images that were compressed by RVL, as RTAB-Map and ROS write them.

A. Wilson, *Fast Lossless Depth Image Compression*, ISS 2017: runs of pixels without depth and with depth alternate, and
depth is the difference to the pixel before; every number is three bits a nibble, the fourth says whether more follow.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.encoded_images import MAX_PIXELS
from ltvn_core.errors import DriveError

_SHIFTS = np.arange(28, -4, -4)
"""A word of 32 bits has eight nibbles, the first in its highest bits."""
_LONGEST = 11
"""Nibbles of a number of 32 bits."""


def decode_rvl(data: bytes, width: int, height: int, source: str) -> NDArray[np.uint16]:
    """Return depth (height, width) in the units in which it was compressed. Raises DriveError where it is damaged."""
    pixels = width * height
    if not 0 < pixels <= MAX_PIXELS or len(data) < 4:
        raise DriveError(f"{source}: {len(data):,} bytes are no depth image of {width} x {height}.")
    numbers = _numbers(data, source)
    places, steps = _runs(numbers, pixels, source)
    change = (steps >> 1) ^ -(steps & 1)
    image = np.zeros(pixels, np.uint16)
    image[places] = np.cumsum(change).astype(np.uint16)
    return image.reshape(height, width)


def _numbers(data: bytes, source: str) -> NDArray[np.int64]:
    """Return all numbers of the stream."""
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4")
    nibbles = ((words[:, None] >> _SHIFTS.astype(np.uint32)) & 0xF).ravel().astype(np.int64)
    ends = np.flatnonzero(nibbles < 8)
    begins = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    if len(ends) == 0 or (ends - begins).max() >= _LONGEST:
        raise DriveError(f"{source}: the compressed depth is damaged.")
    place = np.arange(ends[-1] + 1) - np.repeat(begins, ends - begins + 1)
    return np.add.reduceat((nibbles[: ends[-1] + 1] & 7) << (3 * place), begins)


def _runs(numbers: NDArray[np.int64], pixels: int, source: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which pixels have depth (N,), and the number that stands for each (N,)."""
    places, steps = [], []
    read, pixel = 0, 0
    while pixel < pixels:
        if read + 1 >= len(numbers):
            raise DriveError(f"{source}: the compressed depth ends after {pixel:,} of {pixels:,} pixels.")
        empty, full = int(numbers[read]), int(numbers[read + 1])
        read, pixel = read + 2, pixel + empty
        if empty + full == 0 or pixel + full > pixels or read + full > len(numbers):
            raise DriveError(f"{source}: the compressed depth is damaged.")
        places.append(np.arange(pixel, pixel + full))
        steps.append(numbers[read : read + full])
        read, pixel = read + full, pixel + full
    return np.concatenate(places), np.concatenate(steps)
