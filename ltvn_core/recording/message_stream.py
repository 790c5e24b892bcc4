"""What Rerun would write into a file, taken from memory message by message.

Owns the shape in which Rerun hands out encoded rows. Knows no file: whoever takes the messages writes them, and Rerun
never waits for a disk. Rerun's table of the chunks in a block goes to a `ChunkTable`, which makes one table of all.
"""

from collections.abc import Sequence

import rerun as rr

from ltvn_core.errors import RecordingError
from ltvn_core.recording.chunk_table import ChunkTable
from ltvn_core.recording.rrd_framing import CHUNK_KIND, END_KIND, HEADER_BYTES, MESSAGE_HEADER

_STORE_KIND = 1
_TIMEOUT_S = 10.0
"""Rerun needs milliseconds; a machine that is short of memory may need longer."""


class MessageStream:
    """The encoded messages of a Rerun stream, each handed out once; for one thread at a time."""

    def __init__(self, rerun: rr.RecordingStream, table: ChunkTable) -> None:
        """Take over what `rerun` logs from now on; `table` gets what Rerun says of its chunks."""
        self._encoded = rerun.binary_stream()
        self._table = table
        self._stores: set[bytes] = set()
        self._begun = False

    def take(self) -> Sequence[bytes]:
        """Return the header first, and whole messages with all that was logged since the last call.

        Raises RecordingError when Rerun cannot encode it.
        """
        try:
            block = self._encoded.read(flush=True, flush_timeout_sec=_TIMEOUT_S)
        except (RuntimeError, ValueError) as error:
            raise RecordingError(f"Rerun could not encode what was to be recorded ({error}).") from error
        if not block:
            return ()
        header = () if self._begun else (block[:HEADER_BYTES],)
        self._begun = True
        return [*header, *(message for message in self._messages(block) if self._is_new(message))]

    def _messages(self, block: bytes) -> Sequence[bytes]:
        """Return the messages of what Rerun hands out: a small file with header, messages and an end."""
        position, messages, chunks, footer = HEADER_BYTES, list[bytes](), list[int](), b""
        while position + MESSAGE_HEADER.size <= len(block):
            kind, length = MESSAGE_HEADER.unpack_from(block, position)
            payload = position + MESSAGE_HEADER.size
            if kind == END_KIND:
                footer = block[payload : payload + length]
                break
            if kind == CHUNK_KIND:
                chunks.append(payload)
            messages.append(block[position : payload + length])
            position = payload + length
        self._table.add(footer, chunks)
        return messages

    def _is_new(self, message: bytes) -> bool:
        """Tell whether a message belongs into the file; Rerun says more than once to which store rows belong."""
        if MESSAGE_HEADER.unpack_from(message)[0] != _STORE_KIND:
            return True
        known = message in self._stores
        self._stores.add(message)
        return not known
