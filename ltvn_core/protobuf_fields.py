"""The small part of protobuf that recordings and bags need: fields of numbers and of bytes. Does not know any message
type."""

from collections.abc import Iterator
from typing import NamedTuple

_NUMBER = 0
_EIGHT_BYTES = 1
_BYTES = 2
_FOUR_BYTES = 5
_FIXED_BYTES = {_EIGHT_BYTES: 8, _FOUR_BYTES: 4}
_MOST_BITS = 64
"""Largest number of bits of a number; reading a longer number would take quadratic time."""


class Field(NamedTuple):
    """A field of a message."""

    number: int
    value: int | bytes


def number_field(number: int, value: int) -> bytes:
    """Encode a field that holds an unsigned number."""
    return varint(number << 3 | _NUMBER) + varint(value)


def bytes_field(number: int, value: bytes) -> bytes:
    """Encode a field that holds bytes: a text or another message."""
    return bytes_field_start(number, len(value)) + value


def bytes_field_start(number: int, length: int) -> bytes:
    """Encode the key and the length of a field that holds bytes."""
    return varint(number << 3 | _BYTES) + varint(length)


def varint(number: int) -> bytes:
    """Encode an unsigned number, with seven bits in each byte."""
    parts = bytearray()
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*parts, number])


def read_fields(message: bytes) -> Iterator[Field]:
    """Yield the fields of a message in order. Raises ValueError if it is not a message."""
    place = 0
    while place < len(message):
        key, place = _read_varint(message, place)
        kind = key & 7
        if key >> 3 == 0:
            raise ValueError("a protobuf field has the number 0")
        if kind == _NUMBER:
            value, place = _read_varint(message, place)
            yield Field(key >> 3, value)
            continue
        if kind == _BYTES:
            length, place = _read_varint(message, place)
        elif kind in _FIXED_BYTES:
            length = _FIXED_BYTES[kind]
        else:
            raise ValueError(f"a protobuf field of the unknown kind {kind}")
        if place + length > len(message):
            raise ValueError("a protobuf field exceeds the end of its message")
        yield Field(key >> 3, message[place : place + length])
        place += length


def bytes_fields(message: bytes) -> dict[int, bytes]:
    """Return the fields of a message that hold bytes, by number; the last of repeated fields counts. Raises
    ValueError."""
    return {field.number: field.value for field in read_fields(message) if isinstance(field.value, bytes)}


def _read_varint(message: bytes, place: int) -> tuple[int, int]:
    """Return a number and the position after it."""
    if place < len(message) and message[place] < 0x80:  # Most are small.
        return message[place], place + 1
    number = shift = 0
    while place < len(message):
        byte = message[place]
        number |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return number, place
        if shift >= _MOST_BITS:
            raise ValueError("a protobuf number of more than 64 bits")
    raise ValueError("a protobuf number exceeds the end of its message")
