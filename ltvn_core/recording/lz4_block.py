"""Decompresses damaged LZ4 blocks as far as they can be: what stands before and behind the damage comes out right.

Owns the walk over a block's sequences. Whoever asks must check what comes out; whole blocks are Arrow's business.
"""

from collections.abc import Iterator
from typing import NamedTuple

_LONG = 15
"""A length of four bits that goes on in the bytes that follow."""
_SHORTEST_MATCH = 4
_MOST_RATIO = 255
"""No block grows by more."""
_MOST_BYTES = 1 << 30
_SHIFTS = 8


class _Sequence(NamedTuple):
    """Some bytes as they are, and then some that stand further up already."""

    literals: bytes
    back: int
    """How far up the bytes to repeat begin; 0 in the last sequence."""
    match: int
    """How many bytes to repeat."""


def decompressed(block: bytes, size: int) -> Iterator[bytes]:
    """Yield what a damaged block of once `size` bytes may have held, `size` bytes each; the likeliest first.

    Damage to a length moves all that stands behind it. So where the sizes do not fit, the bytes behind some places are
    moved back to where they must have stood.
    """
    if not 0 < size <= min(_MOST_BYTES, _MOST_RATIO * len(block)):
        return
    sequences, total = list[_Sequence](), 0
    for sequence in _sequences(block):
        sequences.append(sequence)
        total += len(sequence.literals) + sequence.match
        if total > 2 * size + _MOST_RATIO:
            break  # A length that became very large.
    yield _joined(sequences, size, len(sequences), 0)
    if total != size and len(sequences) > 1:
        for part in range(1, _SHIFTS):
            yield _joined(sequences, size, part * len(sequences) // _SHIFTS, size - total)


def _joined(sequences: list[_Sequence], size: int, moved_from: int, by: int) -> bytes:
    """Return what sequences say, those from number `moved_from` on moved `by` bytes."""
    out = bytearray(size)
    place = 0
    for number, (literals, back, match) in enumerate(sequences):
        if number == moved_from:
            place = max(0, place + by)
        if place >= size:
            break
        fitting = literals[: size - place]
        out[place : place + len(fitting)] = fitting
        place += len(literals)
        if 0 < back <= place < size:
            _repeat(out, place, back, min(match, size - place))
        place += match
    return bytes(out)


def _repeat(out: bytearray, place: int, back: int, count: int) -> None:
    repeated = out[place - back : min(place - back + count, place)]
    out[place : place + count] = (repeated * (count // len(repeated) + 1))[:count]


def _sequences(block: bytes) -> Iterator[_Sequence]:
    """Walk over a block up to its end; the last sequence of a damaged one may be cut."""
    place = 0
    while place < len(block):
        token = block[place]
        count, place = _length(block, place + 1, token >> 4)
        literals = block[place : place + count]
        place += count
        if place + 2 > len(block):
            yield _Sequence(literals, 0, 0)
            return
        back = int.from_bytes(block[place : place + 2], "little")
        match, place = _length(block, place + 2, token & _LONG)
        yield _Sequence(literals, back, match + _SHORTEST_MATCH)


def _length(block: bytes, place: int, length: int) -> tuple[int, int]:
    """Return a length that begins with four bits, and the place behind it."""
    if length < _LONG:
        return length, place
    while place < len(block):
        more = block[place]
        length, place = length + more, place + 1
        if more < _MOST_RATIO:
            break
    return length, place
