"""A new file that is only appended to, batch by batch, in a separate thread.

Owns writing to the disk: callers never wait for it, and errors of file, folder or disk are detected within a second.
After any error the file still ends with a complete batch of blocks. The content of the blocks is not interpreted.
"""

import logging
import os
import queue
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.atomic_files import open_new_file
from ltvn_core.data.recording.rrf2.closing_record import RecordingEnding
from ltvn_core.errors import RecordingStoppedError, remedy

_LOG = logging.getLogger(__name__)
WAITING_BYTES = 64 << 20
"""Number of waiting bytes at which writing stops, so that memory does not fill up."""
_CHECK_S = 0.5
_SYNC_S = 5.0
"""Interval between syncs to the disk, in seconds; a power failure loses the data since the last sync."""
_STALL_S = 5.0
"""Time after which a disk that accepts nothing counts as unresponsive, in seconds."""
_CLOSE_S = 30.0
"""Longest wait for the disk at the end of a file, in seconds."""
_ENDING_S = 600.0
"""Longest time to encode the ending, in seconds. An hour of recording needs seconds on an idle core, and a minute on a
machine with thirty busy programs; this does not wait for the disk."""


@dataclass(frozen=True)
class WritingFailure:
    """Reason why writing stopped."""

    cause: str
    """What happened, without the name of the file."""
    remedy: str
    """What to do, as a command without a full stop."""
    text: str
    """The message for a file that stays under its name, with what is kept of it."""

    def error(self, text: str = "") -> RecordingStoppedError:
        """Return the exception, with another text if one is given."""
        return RecordingStoppedError(text or self.text, cause=self.cause, remedy=self.remedy)


class FilePlace:
    """Checks that an open file is still at its path. All methods raise OSError when the disk does not answer."""

    def __init__(self, path: Path, file: int, min_free_bytes: int) -> None:
        """Watch the open `file` at `path`; its disk must keep `min_free_bytes` free."""
        self._path = path
        self._file = file
        self._min_free_bytes = min_free_bytes
        # If they differ from the start, as in some network folders, only the existence of the path can be checked.
        self._is_name_telling = _same_file(os.stat(path), os.fstat(file))

    def misplacement(self) -> WritingFailure | None:
        """Return a failure if the file is no longer at its path, else None."""
        opened = os.fstat(self._file)
        try:
            named = os.stat(self._path)
        except FileNotFoundError:
            named = None
        if named is not None and (not self._is_name_telling or _same_file(named, opened)):
            return None
        if opened.st_nlink == 0:
            text = f"{self._path} was deleted while it was being recorded, and its content is lost. Record again."
            return WritingFailure("it was deleted while it was being written", "leave it in its place", text)
        text = (
            f"{self._path} is no longer in its place: the file or one of its folders was renamed or replaced, or the "
            f"disk was unmounted. What was recorded before is in the file{self._new_place()}. Record again."
        )
        return WritingFailure("it was moved while it was being written", "leave it in its place", text)

    def lack_of_room(self) -> WritingFailure | None:
        """Return a failure if the disk has too little room left, else None."""
        free = self._free_bytes()
        if free >= self._min_free_bytes:
            return None
        left = f"{free >> 20} MiB are left, recording needs {self._min_free_bytes >> 20} MiB"
        text = (
            f"The disk under {self._path.parent} is full: {left}. Everything up to here is kept. Free some space, then "
            "record again."
        )
        return WritingFailure(f"the disk is full: {left}", "free some space, or name another place", text)

    def _free_bytes(self) -> int:
        if not hasattr(os, "fstatvfs"):  # Windows.
            return shutil.disk_usage(self._path.parent).free
        disk = os.fstatvfs(self._file)
        return disk.f_bavail * disk.f_frsize

    def _new_place(self) -> str:
        try:
            place = os.readlink(f"/proc/self/fd/{self._file}")
        except OSError:
            return ""
        return f", now {place}" if place != str(self._path.absolute()) and os.path.exists(place) else ""


def _same_file(one: os.stat_result, other: os.stat_result) -> bool:
    return (one.st_dev, one.st_ino) == (other.st_dev, other.st_ino)


class AppendedFile:
    """A new file that only its owner may read, and the thread that writes it.

    Raises RecordingError at once if the file exists already, cannot be created or has no room. Later errors are not
    raised: `failure` gives the reason why writing stopped, and the file keeps all complete batches.
    """

    def __init__(self, path: Path, *, min_free_bytes: int, ending: RecordingEnding) -> None:
        """Create the file; it fails if its disk has less than `min_free_bytes` left."""
        self.path = path
        self.failure: WritingFailure | None = None
        """Reason why writing stopped, or None."""
        self._ending = ending
        self._size_bytes = 0
        self._queue: queue.SimpleQueue[Sequence[bytes] | None] = queue.SimpleQueue()
        self._handed_in = self._dealt_with = 0  # In bytes.
        self._progress = threading.Condition()
        self._ending_is_known = threading.Event()
        self._file = open_new_file(path)
        self._place = FilePlace(path, self._file, min_free_bytes)
        if (full := self._place.lack_of_room()) is not None:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise full.error(f"{path} cannot be written ({full.cause}); {full.remedy}.")
        self._thread = threading.Thread(target=self._run, name="recording-disk", daemon=True)
        self._thread.start()

    @property
    def waiting_bytes(self) -> int:
        """Number of bytes that were appended but not written yet."""
        return self._handed_in - self._dealt_with

    def append(self, blocks: Sequence[bytes]) -> None:
        """Append blocks that belong together, from one thread at a time; never waits.

        Either all of them are written or none; after a failure they are discarded.
        """
        if not blocks or self.failure is not None:
            return
        if self.waiting_bytes > WAITING_BYTES:
            waiting = f"{self.waiting_bytes >> 20} MiB wait to be written"
            text = (
                f"The disk under {self.path} is too slow: {waiting}. What was written before is kept in the file. "
                "Record onto a faster disk."
            )
            self._fail(WritingFailure(f"the disk is too slow: {waiting}", "name a place on a faster disk", text))
            return
        self._handed_in += sum(map(len, blocks))
        self._queue.put(blocks)

    def wait_until_written(self, *, at_most_s: float, waiting_bytes: int = 0) -> bool:
        """Wait until at most `waiting_bytes` are waiting, or writing fails; return whether that happened in time.

        Ends early if the disk accepts nothing for a while.
        """
        until = time.monotonic() + at_most_s
        with self._progress:
            while self.waiting_bytes > waiting_bytes and self.failure is None:
                before = self._dealt_with
                left = until - time.monotonic()
                self._progress.wait(max(0.0, min(left, _STALL_S)))
                if left <= 0 or (left > _STALL_S and self._dealt_with == before and self.failure is None):
                    return False
        return True

    def close(self) -> None:
        """Write the waiting blocks and then the ending, within a limited time. A second call does nothing.

        After a failure only the ending is written, so that a file on a full disk is finished if there is room for the
        ending.
        """
        self._queue.put(None)
        in_time = self.wait_until_written(at_most_s=_CLOSE_S)
        if in_time:
            self._ending_is_known.wait(_ENDING_S)
        self._thread.join(_STALL_S if in_time else 0)
        if self._thread.is_alive():
            text = (
                f"The disk under {self.path} does not answer, and what was recorded last may be missing. Check the "
                f"disk, then run `ltvn verify {self.path}`."
            )
            self._fail(WritingFailure("the disk does not answer", "check the disk", text))

    def _run(self) -> None:
        try:
            self._write_until_closed()
            self._end()
            self._check()
            self._bring_to_disk()
        except Exception as error:  # The failure is reported, so that nobody waits for a dead thread.
            _LOG.exception("%s was given up", self.path)
            self._fail(_broken(self.path, f"{type(error).__name__}: {error}", "check that the disk works"))
        finally:
            self._ending_is_known.set()
            self._attempt(lambda: os.close(self._file))

    def _write_until_closed(self) -> None:
        checked = synced = time.monotonic()
        while (blocks := self._next()) is not None:
            if self.failure is None and self._write(blocks):
                for block in blocks:
                    self._ending.count(block)
            with self._progress:
                self._dealt_with += sum(map(len, blocks))
                self._progress.notify_all()
            if (now := time.monotonic()) >= checked + _CHECK_S:
                checked = now
                self._check()
            if now >= synced + _SYNC_S:
                synced = now
                self._bring_to_disk()

    def _end(self) -> None:
        """Write the ending; if there is no room for it, write the short ending."""
        complete = self.failure is None
        ending = self._ending.encoded(complete=complete)
        self._ending_is_known.set()
        if self._put(ending) is not None:
            self._write([self._ending.encoded(complete=complete, is_short=True)])

    def _next(self) -> Sequence[bytes] | None:
        try:
            return self._queue.get(timeout=_CHECK_S)
        except queue.Empty:
            return ()

    def _write(self, blocks: Sequence[bytes]) -> bool:
        """Write either all of the blocks or none; return whether they were written."""
        problem = self._put(b"".join(blocks))
        if problem is not None:
            self._fail(problem)
        return problem is None

    def _put(self, data: bytes) -> WritingFailure | None:
        """Write either all of the bytes or none; return the error, if any."""
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError as error:
            self._attempt(lambda: os.ftruncate(self._file, self._size_bytes))
            return _refused(self.path, error)
        self._size_bytes += len(data)
        return None

    def _check(self) -> None:
        """Check that the file is still at its path, and that there is room for more."""
        if self.failure is None:
            problem = self._attempt(self._place.misplacement) or self._attempt(self._place.lack_of_room)
            if problem is not None:
                self._fail(problem)

    def _bring_to_disk(self) -> None:
        if self.failure is None:
            self._attempt(lambda: _to_disk(self._file))

    def _attempt(self, job: Callable[[], WritingFailure | None]) -> WritingFailure | None:
        """Return the result of a job on the file; an OSError is recorded as the failure."""
        try:
            return job()
        except OSError as error:
            self._fail(_refused(self.path, error))
            return None

    def _fail(self, why: WritingFailure) -> None:
        with self._progress:
            self.failure = self.failure or why
            self._progress.notify_all()


def _to_disk(file: int) -> None:
    # Only Linux can leave the times of a file out.
    getattr(os, "fdatasync", os.fsync)(file)


def _refused(path: Path, error: OSError) -> WritingFailure:
    return _broken(path, error.strerror or str(error), remedy(error))


def _broken(path: Path, cause: str, remedy: str) -> WritingFailure:
    text = (
        f"{path} could not be written to the end ({cause}). What was recorded before is in the file: run `ltvn verify "
        f"{path}`, and `ltvn repair {path} --output NEW.rrd` if it reports damage. To record more, {remedy}."
    )
    return WritingFailure(cause, remedy, text)
