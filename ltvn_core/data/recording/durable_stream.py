"""A Rerun stream to one new file; a crash loses little, and write errors are reported.

Owns the format in which Rerun returns encoded rows, the interval at which they are written, and the ending of a
recording. Rerun never waits for a disk, and a signal that ends a verb never separates rows that belong together. The
writer defines entities and events; `appended_file` writes to the disk.
"""

import atexit
import logging
import os
import signal
import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

import pyarrow as pa
import rerun as rr
import rerun_bindings

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.appended_file import WAITING_BYTES, AppendedFile
from ltvn_core.data.recording.blueprint import Layout, send_layout
from ltvn_core.data.recording.frame_codec import EncodedFrame
from ltvn_core.data.recording.live_server import LiveServer
from ltvn_core.data.recording.rrf2.chunk_table import ChunkTable
from ltvn_core.data.recording.rrf2.closing_record import RecordingEnding
from ltvn_core.data.recording.rrf2.layout import (
    CHUNK_KIND,
    END_KIND,
    HEADER_BYTES,
    MESSAGE_HEADER,
    STORE_KIND,
    messages,
)
from ltvn_core.data.recording.schema import RowTime
from ltvn_core.data.recording.stream_lock import STREAM_LOCK
from ltvn_core.errors import RecordingError

_INTERRUPTS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)  # Windows has no SIGHUP.
)
_ENCODING_S = 10.0
"""Longest time in seconds for encoding rows; Rerun needs milliseconds, but may need longer if memory is short."""
_LOG = logging.getLogger(__name__)
_TICK_S = 0.25
"""Longest time a row waits in memory, in seconds; a killed process loses this much."""
_BY_TICK_ALONE = rr.ChunkBatcherConfig(flush_tick=3600, flush_num_bytes=1 << 40, flush_num_rows=1 << 40)
"""Makes Rerun gather rows until they are requested."""
_FLUSH_S = 60.0
PATIENCE_S = 60.0
"""Longest time for which the disk may delay a run before the recording is given up, in seconds."""


class _Times(threading.local):
    """Current time of each recording in this thread, as Rerun stores it: two streams of one recording share it."""

    def __init__(self) -> None:
        self.of: dict[str, RowTime] = {}


_TIMES = _Times()


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Postpone Ctrl-C, SIGTERM and SIGHUP until after the block.

    Python runs their handlers in the main thread, between any two bytecode steps; other threads are not interrupted.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    # Without a Python handler, a signal ends the process at once, or is ignored.
    handlers = {number: found for number in _INTERRUPTS if callable(found := signal.getsignal(number))}
    for number in handlers:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in came:
            handlers[signal.Signals(number)](number, frame)


class MessageStream:
    """The encoded messages of a Rerun stream, each returned once; used by one thread at a time."""

    def __init__(self, rerun: rr.RecordingStream, table: ChunkTable) -> None:
        """Take over all that `rerun` logs from now on; `table` receives Rerun's tables of the chunks."""
        self._encoded = rerun.binary_stream()
        self._table = table
        self._stores: set[bytes] = set()
        self._begun = False

    def take(self) -> Sequence[bytes]:
        """Return the complete messages logged since the last call; at the first call, the file header comes first.

        Raises RecordingError if Rerun cannot encode them.
        """
        try:
            block = self._encoded.read(flush=True, flush_timeout_sec=_ENCODING_S)
        except (RuntimeError, ValueError) as error:
            raise RecordingError(f"Rerun could not encode a message of the recording ({error}).") from error
        if not block:
            return ()
        taken = [] if self._begun else [block[:HEADER_BYTES]]
        self._begun = True
        chunks, footer = list[int](), b""
        for kind, begin, end in messages(block):
            message = block[begin:end]
            if kind == END_KIND:
                footer = message[MESSAGE_HEADER.size :]
                break
            if kind == CHUNK_KIND:
                chunks.append(begin + MESSAGE_HEADER.size)
            # Rerun repeats the description of a store, which is written once.
            elif kind == STORE_KIND:
                if message in self._stores:
                    continue
                self._stores.add(message)
            taken.append(message)
        self._table.add(footer, chunks)
        return taken


class DurableStream:
    """Writes rows to a `.rrd` file; a killed process loses at most the last half second.

    Raises RecordingError at the start if the file exists already or cannot be created, and once, from the next `log`,
    if the disk stops accepting data. After that, rows are discarded, so that a robot can drive on. With a `live_port`,
    Rerun viewers on this machine can watch the recording; raises ServerError if the port is taken.
    """

    def __init__(
        self,
        path: Path,
        *,
        recording_id: str,
        min_free_bytes: int,
        live_port: int | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Begin the file. `together` waits up to `patience_s` for a slow disk; 0 is for a robot in real time."""
        self.path = path
        self._patience_s = patience_s
        self._failure: str | None = None
        self._failure_told = False
        self._closed = False
        self._is_of_parent = False
        """Whether this process was forked from the one that writes the file, and has none of its threads."""
        self._recording_id = recording_id
        _TIMES.of.pop(recording_id, None)
        self._layout: Layout | None = None
        self._description: rr.AsComponents | None = None
        self._lock = threading.RLock()
        """Guards the logged rows; never held while waiting for the disk."""
        self._ending = RecordingEnding(recording_id)
        self._live = None if live_port is None else LiveServer(live_port, path)
        try:
            self._file = AppendedFile(path, min_free_bytes=min_free_bytes, ending=self._ending)
        except BaseException:
            self._close_live()
            raise
        with STREAM_LOCK:
            # Rerun keeps the threads and buffers of a finished recording until they are released explicitly.
            with suppress(RuntimeError):  # In a forked process, those of its parent cannot be released.
                rerun_bindings.flush_and_cleanup_orphaned_recordings()
            self._rerun = rr.RecordingStream(
                schema.APPLICATION_ID, recording_id=recording_id, batcher_config=_BY_TICK_ALONE
            )
        self._messages = MessageStream(self._rerun, self._ending.chunks)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recording-rows", daemon=True)
        self._thread.start()
        atexit.register(self._close_quietly)
        _OPEN.add(self)

    @property
    def failure(self) -> str | None:
        """Reason why the recording stopped after a failure, or None."""
        return self._failure or (None if (broken := self._file.failure) is None else broken.text)

    @property
    def closed(self) -> bool:
        """Whether the file is finished, or writing has failed."""
        return self._closed

    def begin(self, name: str, description: rr.AsComponents, layout: Layout) -> None:
        """Write the recording's description, and for live viewers the initial layout."""
        self._description = description
        self._rerun.send_property(schema.PROPERTIES, description)
        self._pass_on()  # First in the file, so that a file that was cut off still has its description.
        self._rerun.send_recording_name(name)
        self._layout = layout
        if self._live is not None:
            # A layout takes 150 kB in the finished file, so only a recording with a live viewer has two layouts.
            send_layout(self._rerun, layout)
            self._live.start()

    @contextmanager
    def together(self) -> Iterator[None]:
        """Write all rows that are logged in the block, or none of them; first waits for a slow disk."""
        if self._patience_s and not self._is_of_parent and self._file.waiting_bytes > WAITING_BYTES // 2:
            self._file.wait_until_written(at_most_s=self._patience_s, waiting_bytes=WAITING_BYTES // 2)
        with interrupts_deferred(), self._lock:
            yield

    def log(self, time: RowTime, entity: str, *values: rr.AsComponents) -> None:
        """Write one row of an entity at a time; only this method sets the timelines, always all of them together."""
        with self._lock:
            if not self._taking():
                return
            self._set_time(time)
            self._rerun.log(entity, values[0], *values[1:])
            self._ending.rows[entity] += 1

    def index(self, frame: EncodedFrame) -> None:
        """Enter a frame, whose rows are logged in the same block, in the index of the finished file."""
        with self._lock:
            if self._taking():
                self._ending.frames.append(
                    frame.step, frame.stamp, frame.odometry, frame.exact_pose, has_original=frame.original is not None
                )

    def send(self, batch: pa.RecordBatch) -> None:
        """Write rows as Rerun's readers return them."""
        with self._lock:
            if self._taking():
                self._rerun.send_record_batch(batch)

    def log_static(self, entity: str, *values: rr.AsComponents) -> None:
        """Write data without a time, which holds throughout the recording."""
        with self._lock:
            if self._taking():
                self._rerun.log(entity, values[0], *values[1:], static=True)
                self._ending.static_rows[entity] += 1

    def arrange(self, layout: Layout) -> None:
        """Replace the initial layout of the finished file."""
        self._layout = layout

    def flush(self) -> None:
        """Write everything to the file now; blocks, so do not call it while driving."""
        if self._is_of_parent:
            return
        self._pass_on()
        if not self._file.wait_until_written(at_most_s=_FLUSH_S):
            _LOG.warning("The disk is slow: %s still waits for its data.", self.path)
        self._raise_once()

    def close(self) -> None:
        """Finish the file. Raises RecordingError if that fails; a second call does nothing.

        Waits for the disk at most half a minute, and only seconds for a disk that accepts nothing. In a forked process
        it does nothing, because the file belongs to the parent.
        """
        if self._is_of_parent:
            return
        with self._lock:
            self._closed = True
        self._stop.set()
        self._thread.join()
        atexit.unregister(self._close_quietly)
        self._raise_once()

    def _run(self) -> None:
        while not self._stop.wait(_TICK_S) and self.failure is None:
            self._pass_on()
        with self._lock:
            self._closed = True
        if self._description is not None:
            # Twice in the file, so that damage at one place leaves the other copy.
            self._rerun.send_property(schema.PROPERTIES, self._description)
        if self._layout is not None:
            send_layout(self._rerun, self._layout)
        self._pass_on()
        self._rerun.disconnect()
        self._file.close()
        self._close_live()

    def pause(self) -> None:
        """Keep other threads from logging until `go_on`."""
        self._lock.acquire()

    def go_on(self) -> None:
        """Let other threads log again."""
        self._lock.release()

    def leave_to_parent(self) -> None:
        """Never touch the file again; called in a process that was forked, where locks may be held for ever."""
        self._is_of_parent = self._closed = True
        self._lock = threading.RLock()
        atexit.unregister(self._close_quietly)

    def _close_live(self) -> None:
        if self._live is not None:
            self._live.close()

    def _pass_on(self) -> None:
        """Write to the file all data that was logged since the last call."""
        with self._lock:
            try:
                self._file.append(self._messages.take())
            except RecordingError as error:
                self._failure = self._failure or str(error)

    def _set_time(self, time: RowTime) -> None:
        # Setting it costs as much as a small row.
        if _TIMES.of.get(self._recording_id) == time:
            return
        self._rerun.set_time(schema.STEP, sequence=time.step)
        self._rerun.set_time(schema.SIM_TIME, duration=time.stamp)
        if time.event is None:
            self._rerun.disable_timeline(schema.EVENT)
        else:
            self._rerun.set_time(schema.EVENT, sequence=time.event)
        _TIMES.of[self._recording_id] = time

    def _taking(self) -> bool:
        self._raise_once()
        if self._is_of_parent:
            raise RecordingError(
                f"{self.path} is recorded by the process that this one was forked from; record into a file of your own."
            )
        if self._closed and not self.failure:
            raise RecordingError(f"The recording {self.path} is closed; open a new one to record more.")
        return self.failure is None

    def _raise_once(self) -> None:
        if self.failure and not self._failure_told:
            self._failure_told = True
            if self._failure is None and (broken := self._file.failure) is not None:
                raise broken.error()
            raise RecordingError(self.failure)

    def _close_quietly(self) -> None:
        try:
            self.close()
        except RecordingError as error:
            _LOG.error("%s", error)


_OPEN: "weakref.WeakSet[DurableStream]" = weakref.WeakSet()
_AT_FORK: "list[DurableStream]" = []


def _before_fork() -> None:
    """Let no thread be within Rerun, whose locks would stay held in the new process."""
    _AT_FORK[:] = list(_OPEN)
    for stream in _AT_FORK:
        stream.pause()


def _after_fork_in_parent() -> None:
    for stream in _AT_FORK:
        stream.go_on()


def _after_fork_in_child() -> None:
    rerun_bindings.cleanup_if_forked_child()
    for stream in _AT_FORK:
        stream.leave_to_parent()


if hasattr(os, "register_at_fork"):  # Windows has no fork.
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork_in_parent, after_in_child=_after_fork_in_child)
