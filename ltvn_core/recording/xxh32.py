"""XXH32, the checksum that Rerun keeps of its table of chunks.

The algorithm is Yann Collet's, https://github.com/Cyan4973/xxHash/blob/dev/doc/xxhash_spec.md. In plain Python it takes
0.14 s for a megabyte.
"""

import struct

_P1, _P2, _P3, _P4, _P5 = 2654435761, 2246822519, 3266489917, 668265263, 374761393
_MASK = 0xFFFFFFFF
_STRIPE_BYTES = 16


def xxh32(data: bytes, seed: int) -> int:
    """Return the 32-bit checksum of `data`."""
    whole = len(data) // _STRIPE_BYTES * _STRIPE_BYTES
    checksum = _stripes(data[:whole], seed) if whole else seed + _P5
    checksum = (checksum + len(data)) & _MASK
    words = whole + (len(data) - whole) // 4 * 4
    for (word,) in struct.iter_unpack("<I", data[whole:words]):
        checksum = _rotated((checksum + word * _P3) & _MASK, 17) * _P4 & _MASK
    for byte in data[words:]:
        checksum = _rotated((checksum + byte * _P5) & _MASK, 11) * _P1 & _MASK
    checksum = (checksum ^ checksum >> 15) * _P2 & _MASK
    checksum = (checksum ^ checksum >> 13) * _P3 & _MASK
    return checksum ^ checksum >> 16


def _stripes(data: bytes, seed: int) -> int:
    a, b, c, d = (seed + _P1 + _P2) & _MASK, (seed + _P2) & _MASK, seed & _MASK, (seed - _P1) & _MASK
    # Written out, since nearly all time goes by here.
    for first, second, third, fourth in struct.iter_unpack("<4I", data):
        a = (a + first * _P2) & _MASK
        a = (a << 13 | a >> 19) * _P1 & _MASK
        b = (b + second * _P2) & _MASK
        b = (b << 13 | b >> 19) * _P1 & _MASK
        c = (c + third * _P2) & _MASK
        c = (c << 13 | c >> 19) * _P1 & _MASK
        d = (d + fourth * _P2) & _MASK
        d = (d << 13 | d >> 19) * _P1 & _MASK
    return _rotated(a, 1) + _rotated(b, 7) + _rotated(c, 12) + _rotated(d, 18)


def _rotated(word: int, bits: int) -> int:
    return (word << bits | word >> (32 - bits)) & _MASK
