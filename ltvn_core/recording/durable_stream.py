"""A Rerun stream into one new file that loses little when killed and says so when it cannot write.

Owns the file, its flushing and the watch over the disk. Knows no entity and no event: the writer does.
"""

import atexit
import logging
import shutil
import threading
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from ltvn_core.atomic_files import create_new_file
from ltvn_core.errors import RecordingError
from ltvn_core.recording import schema
from ltvn_core.recording.live_server import live_sink
from ltvn_core.recording.rrd_framing import is_finished
from ltvn_core.types import FrameId

_LOG = logging.getLogger(__name__)

_BATCH_S = 0.35
"""Longest time a row waits in memory: what a killed process loses."""
_BATCH_BYTES = 64 << 20
"""Never reached between two ticks. A flush by bytes would make Rerun skip the tick of all the other entities."""
_WATCH_S = 1.0
MIN_FREE_DISK_BYTES = 16 << 20
"""Recording stops, with a whole file, when the disk has less than this left."""


class DurableStream:
    """Rows go in; a `.rrd` file comes out that survives the death of the process up to its last third of a second.

    Raises RecordingError at the start when the file exists already or cannot be made, and once, from the next `log`,
    when the disk stops taking data. After that rows are dropped, so that a robot can drive on. With a `live_port`,
    Rerun viewers of this machine can watch there what is written; raises ServerError when it is taken.
    """

    def __init__(self, path: Path, *, recording_id: str, min_free_bytes: int, live_port: int | None = None) -> None:
        self.path = path
        self._min_free_bytes = min_free_bytes
        self._failure: str | None = None
        self._failure_told = False
        self._closed = False
        self._time: tuple[int, FrameId, float] | None = None
        self._lock = threading.RLock()
        sinks = [] if live_port is None else [live_sink(live_port)]
        create_new_file(path)
        self._check_room()
        if self._failure:
            path.unlink()
            raise RecordingError(self._failure)
        self._rerun = rr.RecordingStream(
            schema.APPLICATION_ID,
            recording_id=recording_id,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=_BATCH_S, flush_num_bytes=_BATCH_BYTES),
        )
        self._rerun.set_sinks(rr.FileSink(path), *sinks)
        self._stop = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="recording-watch", daemon=True)
        self._watcher.start()
        atexit.register(self._close_quietly)

    @property
    def failure(self) -> str | None:
        """Why the recording stopped by itself, or None."""
        return self._failure

    @property
    def closed(self) -> bool:
        """The file is finished, or given up."""
        return self._closed

    def begin(self, name: str, description: rr.AsComponents, blueprint: rrb.Blueprint) -> None:
        """Write what the recording says of itself and the layout in which it opens."""
        self._rerun.send_property(schema.PROPERTIES, description)
        self._rerun.flush()  # First in the file, so that every cut file can still say what it is.
        self._rerun.send_recording_name(name)
        self._rerun.send_blueprint(blueprint)

    def log(self, step: FrameId, stamp: float, entity: str, *values: rr.AsComponents) -> None:
        """Write one row of an entity at a moment; both timelines are always set together, here only."""
        with self._lock:
            if not self._taking():
                return
            self._set_time(int(step), float(stamp))
            self._rerun.log(entity, values[0], *values[1:])

    def log_static(self, entity: str, *values: rr.AsComponents) -> None:
        """Write something that holds at all times."""
        with self._lock:
            if self._taking():
                self._rerun.log(entity, values[0], *values[1:], static=True)

    def flush(self) -> None:
        """Bring everything to the file now; blocks, so never call it while driving."""
        self._flush(timeout_s=60)
        self._raise_once()

    def close(self) -> None:
        """Finish the file. Raises RecordingError when it could not be finished; a second call does nothing."""
        self._finish()
        self._raise_once()

    def _set_time(self, step: FrameId, stamp: float) -> None:
        # Rerun remembers the time per thread, and setting it costs as much as a small row.
        now = (threading.get_ident(), step, stamp)
        if now != self._time:
            self._rerun.set_time(schema.STEP, sequence=step)
            self._rerun.set_time(schema.SIM_TIME, duration=stamp)
            self._time = now

    def _taking(self) -> bool:
        self._raise_once()
        if self._closed and not self._failure:
            raise RecordingError(f"The recording {self.path} is closed; open a new one for what follows.")
        return self._failure is None

    def _raise_once(self) -> None:
        if self._failure and not self._failure_told:
            self._failure_told = True
            raise RecordingError(self._failure)

    def _watch(self) -> None:
        while not self._stop.wait(_WATCH_S):
            self._flush(timeout_s=5)
            self._check_room()
            if self._failure:
                self._finish()
                return

    def _flush(self, timeout_s: float) -> None:
        try:
            self._rerun.flush(timeout_sec=timeout_s)
        except (RuntimeError, ValueError) as error:
            # A slow disk is no failure: the rows stay queued. A writer that gave up is one.
            if "timeout" in str(error).lower() or "timed out" in str(error).lower():
                _LOG.warning("The disk is slow: %s has waited %g s for its data.", self.path, timeout_s)
            elif "grpc" in str(error).lower():
                _LOG.warning("Nobody can watch %s live any more (%s); the file goes on.", self.path, error)
            else:
                self._failure = self._failure or _broken(self.path, str(error))

    def _check_room(self) -> None:
        free = shutil.disk_usage(self.path.parent).free
        if free < self._min_free_bytes:
            self._failure = self._failure or (
                f"The disk under {self.path.parent} is full: {free >> 20} MiB are left, recording needs "
                f"{self._min_free_bytes >> 20} MiB. Everything up to here is kept. Free some space, then record again."
            )

    def _finish(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._stop.set()
            atexit.unregister(self._close_quietly)
            self._rerun.disconnect()
            if not is_finished(self.path):
                self._failure = self._failure or _broken(self.path, "the end of the file is missing")
        if threading.current_thread() is not self._watcher:
            self._watcher.join()

    def _close_quietly(self) -> None:
        try:
            self.close()
        except RecordingError as error:
            _LOG.error("%s", error)


def _broken(path: Path, why: str) -> str:
    return (
        f"{path} could not be written any further ({why}); is the disk full? What was recorded before is in the file: "
        f"run `ltvn repair {path} --output NEW.rrd` to get it back."
    )
