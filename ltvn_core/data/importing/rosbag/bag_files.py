"""The files of a bag as one stream of messages in the order of recording, for all bag formats.

Owns opening, the memory limits, and converting each failure of the library into one clear line. The library `rosbags`
has no limit for decompression, and a kilobyte may claim to hold a terabyte: here nothing is larger than
`MAX_CHUNK_BYTES`. Also owns the leniency that the library lacks for MCAP files that ROS 2 did not write, or not alone,
and the rejection of MCAP files with messages of ROS 1. Message types are known in advance, most of them from `rosbags`;
definitions in the file are never read, because the library generates code from them.
"""

import bz2
import io
import os
import shutil
import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, NamedTuple, Protocol, cast

import lz4.frame
from backports import zstd
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import reader as rosbag1_reader
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import storage_mcap

from ltvn_core.data.importing.rosbag.message_forms import MessageReader, Written
from ltvn_core.data.importing.unfinished_databases import files_beside, finished
from ltvn_core.errors import DriveError

MAX_CHUNK_BYTES = 2**28
"""Largest size of a chunk in bytes. Chunks have about a megabyte, but must hold an image; 256 MB is 60 megapixels of
raw colours."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of a message that is compressed individually; an uncompressed message begins with a zero."""

_HEADER = struct.Struct("<BQI")
"""Fields after the magic bytes: type and length of the first record, and length of the profile's name."""
_MOST_NAME_BYTES = 100

_OFFERS = "offered_qos_profiles"
"""The metadata key that the library looks up."""
_SCHEMAS = ("ros2msg", "ros2idl", "omgidl", "")
_NANOSECONDS = 1e-9
_MAGICS = {".mcap": b"\x89MCAP0\r\n", ".bag": b"#ROSBAG V", ".db3": b"SQLite format 3\0"}
"""First bytes of a file of each kind."""
_COMPRESSED = ".zstd"
"""Suffix of a file that ROS 2 compressed as a whole."""
_MAX_OVERLAPPING_BYTES = 2**30
"""Largest size in bytes of the chunks of an MCAP file that overlap in time; they are in memory together."""
_MAX_RATIO = 1000
"""Largest compression ratio of a file; images compress less, so a higher ratio means a decompression bomb."""


class _Opener(Protocol):
    def __call__(self, file: BinaryIO, /) -> object: ...


def bound_decompression() -> None:
    """Limit the decompression of `rosbags` to the declared size of a chunk, and to `MAX_CHUNK_BYTES`."""
    openers: dict[str, _Opener] = {"lz4": lz4.frame.LZ4FrameFile, "zstd": zstd.ZstdFile, "bz2": bz2.BZ2File}
    storage_mcap.DECOMPRESSORS.update({name: partial(_unpacked, openers[name]) for name in ("lz4", "zstd")})
    rosbag1_reader.decompressors.update({name: partial(_unpacked, openers[name]) for name in ("lz4", "bz2")})


def _unpacked(opener: _Opener, data: bytes, size: int | None = None) -> bytes:
    """Return an unpacked part, which declares `size` bytes or nothing. Raises DriveError if it is too large."""
    most = MAX_CHUNK_BYTES if size is None else size
    if most <= MAX_CHUNK_BYTES:
        with cast(BinaryIO, opener(io.BytesIO(data))) as stream:
            raw = stream.read(most + 1)
        if size is not None or len(raw) <= most:  # The library notices one more byte than declared.
            return raw
    raise DriveError(
        f"A compressed part of the bag unpacks to {'more' if size is None else f'{size:,} bytes'}, but at most "
        f"{MAX_CHUNK_BYTES:,} bytes are read at once; write the bag again with smaller chunks, for instance with "
        "`ros2 bag convert`."
    )


def tolerate_foreign_channels() -> None:
    """Make `rosbags` open MCAP files of any profile, even if a schema has an unknown encoding or is not text.

    This is safe, because each channel has its own encoding, which is checked later.
    """
    known = storage_mcap.get_msgdef

    def definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
        is_known = schema is None or schema.encoding in _SCHEMAS
        return known(schema) if is_known else MessageDefinition(MessageDefinitionFormat.NONE, "")

    def text(stream: BinaryIO) -> str:
        # The only profile that the library opens; the first metadata key of a channel is at 0, too.
        is_first = stream.tell() == 0
        said = storage_mcap.read_bytes(stream).decode(errors="replace")
        return "ros2" if is_first and said != _OFFERS else said

    offered = storage_mcap.get_qos

    def offers(text: bytes) -> list[Qos]:
        try:
            return offered(text)
        except Exception:  # Foreign files hold anything in this field, and reading does not need it.
            return []

    if known.__module__ == storage_mcap.__name__:  # True until the functions are replaced.
        storage_mcap.get_msgdef = definition
        storage_mcap.read_string = text
        storage_mcap.get_qos = offers


def refuse_ros1(file: Path) -> None:
    """Raise DriveError for an MCAP file whose profile says that it holds messages of ROS 1."""
    try:
        with file.open("rb") as stream:
            head = stream.read(len(_MAGICS[".mcap"]) + _HEADER.size + _MOST_NAME_BYTES)
    except OSError:
        return  # The caller reports it.
    if not head.startswith(_MAGICS[".mcap"]) or len(head) < len(_MAGICS[".mcap"]) + _HEADER.size:
        return
    _, _, length = _HEADER.unpack_from(head, len(_MAGICS[".mcap"]))
    begin = len(_MAGICS[".mcap"]) + _HEADER.size
    profile = head[begin : begin + min(length, _MOST_NAME_BYTES)].decode(errors="replace")
    if profile == "ros1":
        raise DriveError(
            f"{file} was not written by ROS 2: it holds messages of ROS 1 (profile ros1). Import the .bag that it was "
            "made of, or convert it to a .bag of ROS 1 or a bag of ROS 2."
        )


class RawMessage(NamedTuple):
    """A message as stored in the bag."""

    topic: str
    msgtype: str
    """Message type of ROS, such as `nav_msgs/msg/Odometry`, whatever the encoding."""
    log_s: float
    """Time of recording, in seconds."""
    data: bytes
    written: Written
    """Encoding and schema of the message."""


@dataclass(slots=True)
class BagTopic:
    """A topic of a bag."""

    name: str
    msgtype: str
    """ROS message type as which its messages are read."""
    written: Written
    """Encoding and schema of its messages."""
    count: int = 0
    """Number of messages."""


class BagFiles:
    """A bag that is ready for reading: its topics, and access to their messages."""

    def __init__(self, path: Path, files: Sequence[Path]) -> None:
        """Check every file of the bag at `path`; `files` are in the order in which they were written. Raises
        DriveError."""
        bound_decompression()
        tolerate_foreign_channels()
        self.path = path
        self.topics: dict[str, BagTopic] = {}
        self.foreign: dict[str, str] = {}
        """Topics that are not read, each with the encoding of its messages."""
        self.duration_s = 0.0
        """Time from the first message to the last, in seconds."""
        self.unfinished = [file.name for file in files if file.suffix == ".db3" and files_beside(file)]
        """Names of the files whose last messages lie in a file beside them."""
        self._files = [finished(file, self) if file.name in self.unfinished else file for file in files]
        self._reader = MessageReader(ros1=self._files[0].suffix == ".bag")
        begin = float("inf")
        end = float("-inf")
        for file in self._files:
            with _opened(file) as reader:
                self._count(reader.connections)
                if any(each.msgcount for each in reader.connections):
                    begin = min(begin, reader.start_time * _NANOSECONDS)
                    end = max(end, reader.end_time * _NANOSECONDS)
        self.duration_s = max(end - begin, 0.0)

    def messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """Yield the messages of some topics in the order of recording. Raises DriveError where the bag is damaged."""
        for file in self._files:
            with _opened(file) as reader:
                wanted = [each for each in reader.connections if each.topic in topics and self._is_read(each)]
                stream = reader.messages(connections=wanted) if wanted else iter(())
                while True:
                    with _explained(file):
                        found = next(stream, None)
                        if found is None:
                            break
                        message = _raw_message(*found)
                    yield message

    def decode(self, message: RawMessage) -> Any:
        """Return the fields of a message as an object of its type. Raises DriveError if the message is damaged."""
        try:
            return self._reader.read(message.data, message.written)
        except Exception as error:  # The library trusts the lengths in a message, so damage may raise anything.
            raise DriveError(
                f"{self.path}: a message of {message.topic} is not a {message.written.schema} ({_said(error)})."
            ) from error

    def _count(self, connections: Collection[Connection]) -> None:
        for each in connections:
            written = Written.of(each)
            if written.msgtype is None:
                self.foreign[each.topic] = written.encoding
                continue
            topic = self.topics.setdefault(each.topic, BagTopic(each.topic, written.msgtype, written))
            topic.count += each.msgcount * self._is_read(each)

    def _is_read(self, connection: Connection) -> bool:
        """Tell whether a channel has the type of the first channel of its topic; channels of other types are not
        used."""
        topic = self.topics.get(connection.topic)
        return topic is not None and Written.of(connection).msgtype == topic.msgtype


@contextmanager
def _opened(file: Path) -> Iterator[Reader1 | Reader2]:
    with ExitStack() as stack:
        with _explained(file):
            if file.suffix == _COMPRESSED:
                file = _decompressed(file, Path(stack.enter_context(TemporaryDirectory())))
        if file.suffix == ".mcap":
            refuse_ros1(file)
        with _explained(file):
            reader = Reader1(file) if file.suffix == ".bag" else Reader2(file)
            stack.enter_context(reader)
            _limit_memory(reader)
        yield reader


def _decompressed(file: Path, folder: Path) -> Path:
    target = folder / file.stem
    most = min(file.stat().st_size * _MAX_RATIO, shutil.disk_usage(folder).free // 2)
    with zstd.open(file, "rb") as packed, target.open("wb") as unpacked:
        while piece := packed.read(2**20):
            if unpacked.tell() > most:
                raise DriveError(
                    f"{file} unpacks to more than {most:,} bytes, which is too large for images or for the free disk; "
                    "unpack it with `zstd -d` and name the unpacked file."
                )
            unpacked.write(piece)
    return target


def _limit_memory(reader: Reader1 | Reader2) -> None:
    """Reject an MCAP file that needs too much memory at once, and limit values in sqlite to the size of a chunk."""
    storage = getattr(reader, "storage", None)
    if (database := getattr(storage, "dbconn", None)) is not None:
        import apsw

        database.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES)
    changes = []
    for chunk in getattr(storage, "chunks", ()):
        changes.append((chunk.message_start_time, chunk.uncompressed_size))
        changes.append((chunk.message_end_time + 1, -chunk.uncompressed_size))
    held = 0
    for _, change in sorted(changes):
        held += change
        if held > _MAX_OVERLAPPING_BYTES:
            raise DriveError(
                f"chunks of more than {_MAX_OVERLAPPING_BYTES:,} bytes have messages of the same time; sort the bag "
                "with `mcap sort`"
            )


def _raw_message(connection: Connection, time_ns: int, data: bytes) -> RawMessage:
    if data[:4] == ZSTD_MAGIC:
        data = _unpacked(zstd.ZstdFile, data)
    if len(data) > MAX_CHUNK_BYTES:
        raise DriveError(f"a message of {connection.topic} has {len(data):,} bytes, more than any image")
    written = Written.of(connection)
    return RawMessage(connection.topic, str(written.msgtype), time_ns * _NANOSECONDS, data, written)


@contextmanager
def _explained(file: Path) -> Iterator[None]:
    """Convert any exception to DriveError, because the library may raise anything for a damaged file."""
    try:
        yield
    except FileNotFoundError as error:
        raise DriveError(f"{file} does not exist; name a bag or its folder.") from error
    except Exception as error:
        raise DriveError(f"{file} cannot be read as a bag: {_said(error)}.{_remedy(file, error)}") from error


def _remedy(file: Path, error: Exception) -> str:
    """Return advice about a file that cannot be read, from its first and last bytes; empty if they show nothing."""
    magic = _MAGICS.get(file.suffix)
    try:
        with file.open("rb") as stream:
            begin = stream.read(16)
            stream.seek(-min(16, file.stat().st_size), os.SEEK_END)
            end = stream.read()
    except OSError:
        return ""
    if magic is None:
        return ""
    if not begin:
        return " The file is empty; name one that holds the drive."
    if not begin.startswith(magic):
        return f" Its first bytes are not those of a {file.suffix} file; name a bag."
    if file.suffix == ".mcap" and not end.endswith(magic):
        return " It was cut off while recording or copying: `mcap recover` writes the whole part to a new file."
    if file.suffix == ".bag" and "index" in str(error).lower():
        return " It was cut off while recording or copying: `rosbag reindex` repairs it."
    return ""


def _said(error: Exception) -> str:
    words = " ".join(str(error).split()).rstrip(".")
    return f"{words or type(error).__name__:.200}"
