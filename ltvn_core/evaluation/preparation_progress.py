"""Progress of the preparation of maps: workers write it to small files, which the process that shows it reads.

Files are used because workers on other machines share only the folder of the evaluation. Owns these files and the share
of the time of each part.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from ltvn_core.atomic_files import atomic_replacement

_EVERY_S = 0.5
"""Least time between two writes of a worker or two reads, in seconds."""


class PreparationPart(Enum):
    """A part of the preparation of a map, with the shares of the time at its beginning and at its end."""

    DRIVE = (0.0, 0.4)
    WEIGHTS = (0.4, 0.7)
    MAP = (0.7, 1.0)

    def share(self, done: float) -> float:
        """Return the finished share of the whole preparation, given the finished share `done` of this part."""
        begin, end = self.value
        return begin + (end - begin) * min(max(done, 0.0), 1.0)


class PreparationLog:
    """Writes the progress of the preparation of one map."""

    def __init__(self, path: Path) -> None:
        """Write to a file at `path`."""
        self._path = path
        self._next_s = 0.0

    def report(self, part: PreparationPart, done: float) -> None:
        """Report the finished share of a part; errors in writing the file are ignored."""
        now = time.monotonic()
        if now < self._next_s:
            return
        self._next_s = now + _EVERY_S
        # Written atomically, because an empty file would read as 0.
        with suppress(OSError), atomic_replacement(self._path) as new:
            new.write_text(f"{part.share(done):.4f}", encoding="ascii")

    def close(self) -> None:
        """Remove the file."""
        with suppress(OSError):
            self._path.unlink(missing_ok=True)


def read_share(path: Path) -> float:
    """Return the share that was written last; 0 if there is none."""
    try:
        return float(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 0.0


def _tell_nobody(number: float) -> None:
    """Ignore the progress."""


@dataclass(frozen=True, slots=True)
class EvaluationProgress:
    """Callbacks for the progress of an evaluation."""

    maps_ready: Callable[[int], object]
    """Called with the number of maps that are ready."""
    work_done: Callable[[int], object]
    """Called with the number of newly finished episodes or queries."""
    preparing: Callable[[float], object] = _tell_nobody
    """Called from a thread, with the finished share of the preparation of all drives, weights and maps."""
    unfinished: Callable[[int], object] = _tell_nobody
    """Called from a thread, with the number of finished episodes in unfinished batches."""


@contextmanager
def told_repeatedly(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell` repeatedly, from a thread, until the block ends."""
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_EVERY_S):
            tell()

    thread = threading.Thread(target=watch, name="evaluation progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
