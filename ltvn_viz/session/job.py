"""A long job beside the driving, one run at a time: idle, running, done, cancelled or failed.

Owns the state of a run, and how its failure is told. Building a map, making a recording and fine-tuning are such jobs.
"""

import logging
import threading
from collections.abc import Callable
from enum import Enum, auto
from typing import Generic, TypeAlias, TypeVar

from ltvn_core.errors import LtvnError, OptionError
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.worker import Worker

logger = logging.getLogger(__name__)

T = TypeVar("T")
Progress: TypeAlias = Callable[[int, int | None], None]
"""Takes the amount done and the total amount, if known; raises JobCancelled to end a cancelled run."""


class Phase(Enum):
    """What a job does, or how its last run ended."""

    IDLE = auto()
    RUNNING = auto()
    DONE = auto()
    CANCELLED = auto()
    FAILED = auto()


class JobCancelled(Exception):
    """A person cancelled the run."""


class Job(Generic[T]):
    """A job with a result. The session's thread begins, cancels and collects it; the worker's thread does it."""

    def __init__(self, worker: Worker) -> None:
        """Run in the thread of `worker`."""
        self._worker = worker
        self.phase = Phase.IDLE
        self.label = ""
        self.images: tuple[int, int | None] = 0, None
        """Images that are done, and of how many."""
        self.cancelled = threading.Event()
        self.result: T | None = None
        """Result of the last run; None unless it is done."""
        self.error: Exception | None = None
        """Why the last run failed."""

    @property
    def work(self) -> JobProgress | None:
        """Progress of the run; None without one."""
        if self.phase is not Phase.RUNNING:
            return None
        return JobProgress("Stopping" if self.cancelled.is_set() else self.label, *self.images)

    @property
    def reason(self) -> str:
        """Why the last run failed, as a sentence."""
        if isinstance(self.error, LtvnError):
            return str(self.error)
        return f"{self.label} failed ({type(self.error).__name__}: {self.error}). The log on the console says more."

    def begin(self, label: str, run: Callable[[Progress], T], then: Callable[[], None]) -> None:
        """Start a run; `then` follows in the session's thread, however it ends. Raises OptionError during another."""
        if self.phase is Phase.RUNNING:
            raise OptionError(f"{self.label} is not done yet; wait for it, or cancel it first.")
        self.phase, self.label, self.images = Phase.RUNNING, label, (0, None)
        self.result = self.error = None
        self.cancelled = threading.Event()

        def end(phase: Phase) -> None:
            self.phase = phase
            then()

        self._worker.submit(lambda: self._tried(run), end)

    def cancel(self) -> None:
        """Cancel the run at its next report of progress."""
        self.cancelled.set()

    def collect(self) -> None:
        """Let the follow-up of a finished run happen."""
        self._worker.collect()

    def close(self) -> None:
        """Cancel the run and wait for the thread."""
        self.cancel()
        self._worker.close()

    def _tried(self, run: Callable[[Progress], T]) -> Phase:
        try:
            self.result = run(self._report)
        except JobCancelled:
            return Phase.CANCELLED
        except BaseException as error:  # A panic of a library in Rust, or a plug-in that exits, must not end the app.
            if not isinstance(error, LtvnError):
                logger.exception("%s failed", self.label)
            self.error = error if isinstance(error, Exception) else RuntimeError(repr(error))
            return Phase.FAILED
        return Phase.DONE

    def _report(self, done: int, total: int | None) -> None:
        if self.cancelled.is_set():
            raise JobCancelled
        self.images = done, total
