"""How far the preparation of maps is: workers write it into small files, and the process that shows it reads them.

Files, because the workers may be processes of other machines that share nothing but the folder of the evaluation. Owns
these files and the share of the work that each part is.
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
"""A worker writes, and the reader reads, at most this often."""


class PreparationPart(Enum):
    """A part of the preparation of a map, and the share of the time up to its beginning and to its end."""

    DRIVE = (0.0, 0.4)
    WEIGHTS = (0.4, 0.7)
    MAP = (0.7, 1.0)

    def share(self, done: float) -> float:
        """Return the share of the whole preparation when `done` of this part is done."""
        begin, end = self.value
        return begin + (end - begin) * min(max(done, 0.0), 1.0)


class PreparationLog:
    """Writes how far the preparation of one map is."""

    def __init__(self, path: Path) -> None:
        """Write into a file of this name."""
        self._path = path
        self._next_s = 0.0

    def report(self, part: PreparationPart, done: float) -> None:
        """Say that a share of a part is done; a file that cannot be written is no reason to stop."""
        now = time.monotonic()
        if now < self._next_s:
            return
        self._next_s = now + _EVERY_S
        # In one step, because a reader who comes between emptying and writing would go back to 0.
        with suppress(OSError), atomic_replacement(self._path) as new:
            new.write_text(f"{part.share(done):.4f}", encoding="ascii")

    def close(self) -> None:
        """Take the file away."""
        with suppress(OSError):
            self._path.unlink(missing_ok=True)


def read_share(path: Path) -> float:
    """Return the share that was written last; 0 where there is none."""
    try:
        return float(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 0.0


def _tell_nobody(number: float) -> None:
    """Show nothing."""


@dataclass(frozen=True, slots=True)
class EvaluationProgress:
    """Callbacks for the progress of an evaluation."""

    maps_ready: Callable[[int], object]
    """Called with the number of maps that are ready."""
    work_done: Callable[[int], object]
    """Called with the number of further episodes or queries that are done."""
    preparing: Callable[[float], object] = _tell_nobody
    """Called from a thread, with the share of all drives, weights and maps that is prepared."""
    unfinished: Callable[[int], object] = _tell_nobody
    """Called from a thread, with the number of episodes that are done in batches that are not."""


@contextmanager
def told_repeatedly(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell` again and again, from a thread, until the block ends."""
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
