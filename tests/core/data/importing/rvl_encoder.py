"""Compresses depth by RVL as the paper describes it, plainly: for tests alone."""

import numpy as np
from numpy.typing import NDArray


def encode_rvl(depth: NDArray[np.uint16]) -> bytes:
    """Return the compressed pixels: runs without and with depth, each number in nibbles."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while True:
            number, digit = number >> 3, number & 7
            nibbles.append(digit | (8 if number else 0))
            if not number:
                return

    pixels = [int(value) for value in depth.ravel()]
    place, previous = 0, 0
    while place < len(pixels):
        begin = place
        while place < len(pixels) and pixels[place] == 0:
            place += 1
        put(place - begin)
        begin = place
        while place < len(pixels) and pixels[place] != 0:
            place += 1
        put(place - begin)
        for value in pixels[begin:place]:
            change = value - previous
            put(2 * change if change >= 0 else -2 * change - 1)
            previous = value
    nibbles += [0] * (-len(nibbles) % 8)
    words = np.array(nibbles, np.uint32).reshape(-1, 8) << np.arange(28, -4, -4).astype(np.uint32)
    return words.sum(axis=1, dtype=np.uint32).astype("<u4").tobytes()
