"""Records the live run into a file of the library, whatever happens.

Owns the life of one recording: start, keep, discard, and what becomes of it when writing fails. Nothing that was
recorded is ever deleted.
"""

import logging
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Protocol

from ltvn_core.errors import LtvnError, RecordingError
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import StampedEvent
from ltvn_core.types import FrameId, Observation
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.snapshot import RecordingStatus
from ltvn_viz.session.worker import Worker

logger = logging.getLogger(__name__)


class RecordingSink(Protocol):
    """Writes one recording."""

    def write_frame(self, observation: Observation) -> None:
        """Append an image."""
        ...

    def write_event(self, stamped: StampedEvent) -> None:
        """Append an event."""
        ...

    def draw_graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


class Recorder:
    """At most one recording at a time."""

    def __init__(
        self,
        library: RecordingLibrary,
        open_writer: Callable[[Path], RecordingSink],
        clock: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Write into `library`; `open_writer` starts a new file with the map as it is, in the worker's thread."""
        self._library, self._open, self._clock = library, open_writer, clock
        self._path: Path | None = None
        self._writer: RecordingSink | None = None
        self._waiting: list[Callable[[RecordingSink], None]] = []
        self._frames = 0
        self._first_s = self._last_s = 0.0

    @property
    def status(self) -> RecordingStatus:
        """What is being recorded now."""
        if self._path is None:
            return RecordingStatus()
        return RecordingStatus(self._path.name, self._frames, self._last_s - self._first_s)

    @property
    def is_on(self) -> bool:
        """Whether a recording is under way."""
        return self._path is not None

    def start(self, worker: Worker) -> None:
        """Begin a recording; raises RecordingError when one is under way or the folder cannot be written.

        The file is begun in the worker's thread; what happens until it is ready waits and goes in first.
        """
        if self._path is not None:
            raise RecordingError(f"{self._path.name} is being recorded already; keep or discard it first.")
        path = self._library.new_path(self._clock())
        self._path, self._frames, self._first_s, self._last_s = path, 0, 0.0, 0.0
        worker.submit(lambda: self._try_open(path), self._opened)

    def write_frame(self, observation: Observation) -> None:
        """Append an image, if a recording is under way; a failure ends the recording and raises RecordingError."""
        if self._path is None:
            return
        if not self._frames:
            self._first_s = observation.stamp
        # The mapper may hand in an image again, which the file then holds once.
        self._frames += not self._frames or observation.stamp > self._last_s
        self._last_s = max(self._last_s, observation.stamp)
        self._write(lambda writer: writer.write_frame(observation))

    def write_event(self, stamped: StampedEvent) -> None:
        """Append an event, if a recording is under way; a failure ends the recording and raises RecordingError."""
        self._write(lambda writer: writer.write_event(stamped))

    def draw_graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map for the viewer, if a recording is under way; nobody may change the map meanwhile."""
        if self._writer is not None:
            self._write(lambda writer: writer.draw_graph(graph, step, stamp))

    def keep(self) -> Path:
        """End the recording and return its file; raises RecordingError when none is under way."""
        path = self._require()
        self._end()
        return path

    def discard(self) -> Path:
        """End the recording, move it aside and return where it is now; raises RecordingError when none is under way."""
        path = self._require()
        self._end()
        return self._library.discard(path)

    def _require(self) -> Path:
        if self._path is None:
            raise RecordingError("Nothing is being recorded; press R to start.")
        return self._path

    def _try_open(self, path: Path) -> RecordingSink | Exception:
        try:
            return self._open(path)
        except (OSError, LtvnError) as error:
            return error

    def _opened(self, writer: RecordingSink | Exception) -> None:
        waiting, self._waiting = self._waiting, []
        if isinstance(writer, Exception):
            self._path = None
            raise RecordingError(f"The recording could not be started: {writer}") from writer
        self._writer = writer
        for write in waiting:
            self._write(write)

    def _write(self, write: Callable[[RecordingSink], None]) -> None:
        if self._path is None:
            return
        if self._writer is None:
            self._waiting.append(write)
            return
        try:
            write(self._writer)
        except (OSError, LtvnError) as error:
            raise self._broken(error) from error

    def _end(self) -> None:
        writer, self._writer, self._path = self._writer, None, None
        if writer is not None:
            writer.close()

    def _broken(self, error: Exception) -> RecordingError:
        path = self._require()
        try:
            self._end()
        except (OSError, LtvnError):
            logger.warning("could not finish %s", path, exc_info=True)
        return RecordingError(
            f"Recording stopped: {error} What was recorded so far is kept in {path}. Free some space, then record "
            "again; `ltvn verify` checks the file and `ltvn repair` mends it."
        )
