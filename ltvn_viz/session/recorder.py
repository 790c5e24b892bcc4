"""Records the live run into a file of the library, and survives failures of the disk.

Owns the life of one recording: start, keep, discard, and the handling of write errors. Files are opened and closed in a
separate thread, so that the session never waits for a disk. Recorded data are never deleted.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

from ltvn_core.errors import LtvnError, OptionError, RecordingError
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId, Observation
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.snapshot import RecordingStatus
from ltvn_viz.session.worker import Worker

if TYPE_CHECKING:
    from ltvn_core.data.recording.writer import RecordingWriter

P = ParamSpec("P")
T = TypeVar("T")

logger = logging.getLogger(__name__)

_OPEN_S = 10.0
"""Time after which a folder that opens no file counts as unresponsive, in seconds."""
_CLOSE_S = 45.0
"""Longest wait for a disk when the app ends, in seconds."""


WholeMap: TypeAlias = tuple[TopologicalGraph, Sequence[Observation]]
"""A complete map, which no longer changes, with its images."""


@dataclass(eq=False)
class _RecordingUnderWay:
    """One recording, from its request to its finished file."""

    began_s: float
    path: Path | None = None
    """Path of the file; None until it exists."""
    writer: "RecordingWriter | None" = None
    has_map: bool = False
    """Whether the map was copied; later changes go into the recording as events."""
    ready: bool = False
    """Whether the map is in the file, so that rows may follow."""
    finished: Callable[[Path], None] | None = None
    """Called with the file at the end; None until the end is requested."""
    closing: bool = False
    waiting: "list[Callable[[RecordingWriter], None]]" = field(default_factory=list)
    frames: int = 0
    first_s: float = 0.0
    last_s: float = 0.0


class Recorder:
    """At most one recording at a time."""

    def __init__(
        self,
        library: RecordingLibrary,
        open_writer: Callable[[Path], "RecordingWriter"],
        clock: Callable[[], datetime] = datetime.now,
        *,
        take_map: Callable[[], WholeMap] = lambda: (TopologicalGraph(), ()),
        scene_glb: Callable[[], bytes | None] = lambda: None,
        executor: Executor | None = None,
    ) -> None:
        """Write into `library`.

        `open_writer` starts a new file, in the recorder's thread. `take_map` returns a copy of the map, which is
        written first; it is called while the map does not change. `scene_glb` is called in the recorder's thread, which
        draws the scene after the first rows. `executor` has a single thread.
        """
        self._library = library
        self._open = open_writer
        self._clock = clock
        self._take_map = take_map
        self._scene_glb = scene_glb
        self._files = Worker(executor or DaemonExecutor("recorder"))
        self._current: _RecordingUnderWay | None = None
        self._failure: str | None = None

    @property
    def status(self) -> RecordingStatus:
        """State of the recording; empty before its file exists."""
        current = self._current
        if current is None or current.path is None:
            return RecordingStatus()
        return RecordingStatus(current.path.name, current.frames, current.last_s - current.first_s)

    @property
    def is_on(self) -> bool:
        """Whether a recording is running or was requested."""
        return self._current is not None

    def start(self) -> None:
        """Request a recording, which `tick` starts; raises OptionError if one is running.

        Rows that arrive before the file is ready are queued and written first.
        """
        if (before := self._current) is not None:
            name = "A recording" if before.path is None else before.path.name
            if before.finished is not None:
                raise OptionError(f"{name} is being finished; record again in a moment.")
            raise OptionError(f"{name} is being recorded already; keep or discard it first.")
        current = self._current = _RecordingUnderWay(time.monotonic())
        self._files.submit(self._try_open, lambda opened: self._opened(current, opened))

    def write_frame(self, observation: Observation) -> None:
        """Append an image, if a recording is running; a failure ends the recording, see `take_failure`."""
        if (current := self._current) is None:
            return
        if not current.frames:
            current.first_s = observation.stamp
        # The mapper may pass the same image again; it counts once.
        current.frames += not current.frames or observation.stamp > current.last_s
        current.last_s = max(current.last_s, observation.stamp)
        self._write(current, lambda writer: writer.write_frame(observation))

    def write_event(self, stamped: StampedEvent) -> None:
        """Append an event, if a recording is running; a failure ends the recording, see `take_failure`."""
        current = self._current
        if current is None or (isinstance(stamped.event, GraphChanged) and not current.has_map):
            return  # Changes before the copy are part of the map.
        self._write(current, lambda writer: writer.write_event(stamped))

    def write_question(self, word: str) -> None:
        """Count a question that a person asked, if a recording is running."""
        if (current := self._current) is not None:
            self._write(current, lambda writer: writer.write_question(word))

    def draw_graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map for the viewer, if a recording is running; the map must not change during the call."""
        if self._current is not None and self._current.ready:
            self._write(self._current, lambda writer: writer.draw_graph(graph, step, stamp))

    def keep(self, then: Callable[[Path], None]) -> None:
        """End the recording soon and call `then` with its finished file; raises OptionError without a recording."""
        if self._current is None:
            raise OptionError("Nothing is being recorded; press R to start.")
        self._current.finished = self._current.finished or then

    def discard(self, then: Callable[[Path], None]) -> None:
        """End the recording soon, move it aside and call `then` with its new path; raises OptionError without a
        recording."""

        def moved(place: Path | Exception) -> None:
            if isinstance(place, Exception):
                raise RecordingError(f"The recording could not be set aside: {place}. It is kept where it is.")
            then(place)

        self.keep(lambda path: self._files.submit(lambda: _tried(lambda: self._library.discard(path)), moved))

    def tick(self, *, map_is_still: bool) -> None:
        """Continue with pending work; `map_is_still` says that the map does not change and all its changes were
        reported.

        Raises RecordingError when a recording could not be started, finished or set aside.
        """
        self._files.collect()
        current = self._current
        if current is None or current.closing:
            return
        if current.writer is not None and current.writer.failure is not None:
            self._broken(current, current.writer.failure)
        elif current.writer is None and time.monotonic() - current.began_s > _OPEN_S:
            self._current = None
            raise RecordingError(f"The recording could not be started: {self._library.folder} does not answer.")
        elif map_is_still:
            self._go_on(current)
            self._files.collect()

    def take_failure(self) -> str | None:
        """Return the reason why a recording failed, once; None if none failed since the last call."""
        failure, self._failure = self._failure, None
        return failure

    def close(self) -> Path | None:
        """End the running recording, wait for its file and return it; the map must not change during the call.

        The wait for a disk is limited. Raises RecordingError as `tick` does, and after the time limit.
        """
        kept = list[Path]()
        if self._current is not None:
            self.keep(kept.append)
        until = time.monotonic() + _CLOSE_S
        while (self._current is not None or self._files.pending) and time.monotonic() < until:
            self.tick(map_is_still=True)
            self._files.wait(0.1)
        if self._current is not None:
            raise RecordingError(f"{self._library.folder} does not answer; what was recorded last may be missing.")
        return kept[0] if kept else None

    def _try_open(self) -> "tuple[Path, RecordingWriter] | Exception":
        try:
            path = self._library.new_path(self._clock())
            return path, self._open(path)
        except (OSError, LtvnError) as error:
            return error

    def _opened(self, current: _RecordingUnderWay, opened: "tuple[Path, RecordingWriter] | Exception") -> None:
        if isinstance(opened, Exception):
            if current is self._current:
                self._current = None
            raise RecordingError(f"The recording could not be started: {opened}") from opened
        current.path, current.writer = opened
        if current is not self._current:
            self._close(current, lambda _outcome: None)

    def _go_on(self, current: _RecordingUnderWay) -> None:
        """Do the next step of a recording: write the map, or finally close the file."""
        writer = current.writer
        if writer is None:
            return
        if not current.has_map:
            graph, observations = self._take_map()
            current.has_map = True
            self._files.submit(
                lambda: _tried(lambda: graph.nodes and writer.write_map(graph, observations)),
                lambda outcome: self._ready(current, outcome),
            )
            self._files.submit(lambda: _tried(lambda: self._draw_scene(writer)), lambda _outcome: None)
        elif current.ready and current.finished is not None and not current.closing:
            current.closing = True
            self._close(current, lambda outcome: self._closed(current, outcome))

    def _draw_scene(self, writer: "RecordingWriter") -> None:
        if (glb := self._scene_glb()) is not None:
            writer.draw_scene(glb)

    def _ready(self, current: _RecordingUnderWay, outcome: object) -> None:
        if isinstance(outcome, Exception):
            self._broken(current, str(outcome))
        current.ready = True
        waiting, current.waiting = current.waiting, []
        for write in waiting:
            self._write(current, write)

    def _write(self, current: _RecordingUnderWay, write: Callable[["RecordingWriter"], None]) -> None:
        if current is not self._current or current.closing:
            return
        if current.writer is None or not current.ready:
            current.waiting.append(write)
            return
        try:
            write(current.writer)
        except (OSError, LtvnError) as error:
            self._broken(current, str(error))

    def _close(self, current: _RecordingUnderWay, then: Callable[[object], None]) -> None:
        assert current.writer is not None
        close = current.writer.close
        self._files.submit(lambda: _tried(close), then)

    def _closed(self, current: _RecordingUnderWay, outcome: object) -> None:
        self._current = None
        assert current.path is not None
        assert current.finished is not None
        if isinstance(outcome, Exception):
            raise RecordingError(str(outcome)) from outcome
        current.finished(current.path)

    def _broken(self, current: _RecordingUnderWay, why: str) -> None:
        """End a recording after a write error; its file is finished as far as possible."""
        if current is not self._current:
            return
        self._current = None
        self._failure = f"Recording stopped, driving goes on. {why}"
        logger.warning("recording %s stopped: %s", current.path, why)
        self._close(current, lambda _outcome: None)


def _tried(job: Callable[[], T]) -> T | Exception:
    """Return the result of a job, or its error."""
    try:
        return job()
    except (OSError, LtvnError) as error:
        return error


class DaemonExecutor(Executor):
    """An executor with a single daemon thread, which never keeps the program from ending.

    At the end of the program the standard library waits for its pools, for ever if a job waits for a lost disk.
    """

    def __init__(self, name: str) -> None:
        """Start the thread."""
        self._jobs: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a job after all earlier ones."""
        future: Future[T] = Future()
        self._jobs.put((future, lambda: fn(*args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the thread end after its jobs; never waits."""
        self._jobs.put(None)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            future, do = job
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(do())
            except BaseException as error:
                future.set_exception(error)
