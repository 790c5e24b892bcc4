"""Converts events and deltas to JSON and back, exactly: every float, tuple and enum is equal afterwards.
Only lone surrogates in texts are replaced.

The text is strict JSON, so that any language can read it: a float that is not finite becomes the string "inf", "-inf"
or "nan". Each union member has its class name as "kind", a change of the world as "change". Owns no file.
"""

import json
import math
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, Self, get_args

import cattrs
import msgspec
import numpy as np
from cattrs.strategies import configure_tagged_union

from ltvn_core.errors import RecordingError
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Event, GraphChanged, StampedEvent
from ltvn_core.structured_text import parse_json
from ltvn_core.types import FrameId
from ltvn_core.worlds import WorldChange


def _plain_float(value: float) -> float | str:
    return float(value) if math.isfinite(value) else str(float(value))


def _converter() -> cattrs.Converter:
    # Error messages quote the whole text, so positions are not needed; reading is a third faster without them.
    converter = cattrs.Converter(detailed_validation=False)
    # Numbers may be numpy scalars, which JSON does not support.
    converter.register_unstructure_hook(float, _plain_float)
    converter.register_unstructure_hook(int, int)
    converter.register_unstructure_hook(bool, bool)
    configure_tagged_union(GraphDelta, converter, tag_name="kind")
    configure_tagged_union(WorldChange, converter, tag_name="change")
    configure_tagged_union(Event, converter, tag_name="kind")
    return converter


_CONVERTER = _converter()

_KINDS_BEFORE = {"LegStarted": "AttemptStarted", "LegEnded": "AttemptEnded"}
"""Former names of event kinds in older recordings -> their present names."""


def encode_event(event: Event) -> str:
    """Write an event as strict JSON."""
    return json.dumps(_CONVERTER.unstructure(event, unstructure_as=Event), allow_nan=False, separators=(",", ":"))


def decode_event(text: str) -> Event:
    """Decode an event, equal to the written one; former names of kinds are converted to present names.

    Raises RecordingError if the text is not an event of this schema.
    """
    try:
        return _decoded_by_type(text)
    except (msgspec.MsgspecError, KeyError):
        return _decoded_by_fields(text)


class _Tagged(msgspec.Struct):
    kind: str


class _Change(msgspec.Struct):
    """A change of the map, whose delta is not decoded yet."""

    delta: msgspec.Raw
    query: int | None = None
    attempt: int | None = None


@cache
def _decoders() -> dict[str, Callable[[bytes | str], Any]]:
    """Return a decoder for each kind of event and of delta that has no choice of types inside."""
    found = dict[str, Callable[[bytes | str], Any]]()
    for kind in (*get_args(Event), *get_args(GraphDelta)):
        with suppress(TypeError):
            found[kind.__name__] = msgspec.json.Decoder(kind).decode
    return found


_TAGGED = msgspec.json.Decoder(_Tagged).decode
_CHANGE = msgspec.json.Decoder(_Change).decode


def _decoded_by_type(text: str) -> Any:
    """Decode an event ten times as fast as by fields. Raises MsgspecError or KeyError for what only that can decode,
    such as a number that is not finite."""
    kind = _TAGGED(text).kind
    if kind != GraphChanged.__name__:
        return _decoders()[kind](text)
    change = _CHANGE(text)
    return GraphChanged(_decoders()[_TAGGED(change.delta).kind](change.delta), change.query, change.attempt)


def _decoded_by_fields(text: str) -> Event:
    try:
        data = _parsed(text)
        return _CONVERTER.structure(data | {"kind": current_kind(data["kind"])}, Event)  # pyright: ignore[reportArgumentType]
    except (ValueError, KeyError, TypeError, cattrs.BaseValidationError) as error:
        raise RecordingError(f"This is not an event of the current schema: {text[:120]}") from error


def _parsed(text: str) -> dict[str, Any]:
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):
        # Half of a surrogate pair, for instance, which a name of a file can contain and Python writes.
        return parse_json(text)


def current_kind(kind: str) -> str:
    """Return the present name of an event kind, which may be a former name."""
    return _KINDS_BEFORE.get(kind, kind)


@dataclass(frozen=True, slots=True)
class EncodedEvent:
    """One event as stored in a recording."""

    sequence: int
    """Number of the event in its recording, starting at 0; gives the order."""
    step: FrameId
    stamp: float
    kind: str
    """Class name of the event, for filtering without reading the JSON."""
    json: str

    @classmethod
    def of(cls, stamped: StampedEvent, *, sequence: int) -> Self:
        """Encode an event with its time and step."""
        event = stamped.event
        return cls(sequence, int(stamped.step), float(stamped.stamp), type(event).__name__, encode_event(event))

    @property
    def checksum(self) -> int:
        """CRC-32 of all data in the row."""
        numbers = np.array([self.sequence, self.step, self.stamp], np.float64).tobytes()
        return zlib.crc32(self.json.encode(), zlib.crc32(numbers))

    def decoded(self) -> StampedEvent:
        """Return the event, equal to the one that was written."""
        return StampedEvent(self.step, self.stamp, decode_event(self.json))
