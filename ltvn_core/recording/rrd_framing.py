"""The outer shape of a `.rrd` file: a header, then messages with their lengths, then a closing mark.

Owns the search for the last whole message, in plain Python, so that a cut file can be read up to the cut. Does not
look into messages.
"""

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

_MAGIC = b"RRF2"
_HEADER_BYTES = 12
_MESSAGE = struct.Struct("<QQ")  # Kind and length of the payload that follows.
_KNOWN_KINDS = (1, 2, 3)
_CLOSING_MARK = b"RRF2FOOT"
_CLOSING_TAIL_BYTES = 12
"""The mark stands this far before the end of the file."""


class RrdFraming(NamedTuple):
    """How far a file is whole."""

    messages: int
    """Whole messages, without the last one that only closes the file."""
    whole_bytes: int
    """Length of the header and these messages."""
    finished: bool
    """The file was closed properly and nothing is missing."""


def is_rrd(path: Path) -> bool:
    """Tell whether the file begins as a Rerun file does."""
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def is_finished(path: Path) -> bool:
    """Tell whether the closing mark stands at the end of the file; quick."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _CLOSING_TAIL_BYTES))
        return file.read(len(_CLOSING_MARK)) == _CLOSING_MARK


def scan_rrd(path: Path) -> RrdFraming:
    """Walk over the messages of a Rerun file up to its end or to where it is cut."""
    with path.open("rb") as file:
        messages, position = _walk(file, file.seek(0, 2))
    return RrdFraming(messages, position, is_finished(path))


def copy_whole_messages(source: Path, target: Path, framing: RrdFraming) -> None:
    """Copy the part of `source` that is whole to a new file."""
    left = framing.whole_bytes
    with source.open("rb") as reading, target.open("xb") as writing:
        while left > 0 and (block := reading.read(min(left, 1 << 20))):
            writing.write(block)
            left -= len(block)


def _walk(file: BinaryIO, size: int) -> tuple[int, int]:
    messages, position = 0, min(size, _HEADER_BYTES)
    while position + _MESSAGE.size <= size:
        file.seek(position)
        kind, length = _MESSAGE.unpack(file.read(_MESSAGE.size))
        end = position + _MESSAGE.size + length
        if kind not in _KNOWN_KINDS or end > size:
            break
        messages, position = messages + 1, end
    return messages, position
