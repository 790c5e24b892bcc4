"""Makes new recordings from files in the folder: at most one at a time, in a separate thread.

Robot and map continue during the job. Owns the state of the job: started, cancelled, failed, done. `command_handlers`
defines the content of the recording.
"""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import NamedTuple, TypeAlias

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.findings import Finding
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.worker import Worker

logger = logging.getLogger(__name__)


class MadeRecording(NamedTuple):
    """A new recording of the library."""

    name: str
    text: str
    """Description of the recording's content."""
    findings: tuple[Finding, ...] = ()
    """Doubtful findings about the recording."""


Progress: TypeAlias = Callable[[int, int | None], None]
"""Called with the amount done and the total amount, if known; raises an exception to end a cancelled job."""
Make: TypeAlias = Callable[[Progress], MadeRecording]
"""Makes a recording, or raises LtvnError and leaves nothing. Runs in the maker's thread."""


class MakingCancelled(Exception):
    """A person cancelled the job."""


class RecordingMaker:
    """Makes recordings."""

    def __init__(self, executor: Executor | None = None) -> None:
        """Work on `executor`, which must have a single thread."""
        self._worker = Worker(executor or ThreadPoolExecutor(1, "new recordings"))
        self._cancelled = threading.Event()
        self._label = ""
        self._images: tuple[int, int | None] = 0, None
        self._result: MadeRecording | str | None = None

    @property
    def work(self) -> JobProgress | None:
        """Progress of the current job; None without one."""
        if not self._worker.pending:
            return None
        return JobProgress("Stopping" if self._cancelled.is_set() else self._label, *self._images)

    def begin(self, label: str, make: Make) -> None:
        """Start a job; raises OptionError while another one is running."""
        if self._worker.pending:
            raise OptionError(f"{self._label} is not done yet; wait for it, or cancel it first.")
        self._label = label
        self._images = (0, None)
        self._cancelled = threading.Event()
        self._worker.submit(lambda: self._run(make), self._ended)

    def cancel(self) -> None:
        """Cancel the job at the next image, and leave no files."""
        self._cancelled.set()

    def collect(self) -> MadeRecording | str | None:
        """Return, once, the result of a finished job, or why it failed."""
        self._worker.collect()
        result, self._result = self._result, None
        return result

    def close(self) -> None:
        """Cancel the job and wait for the thread."""
        self.cancel()
        self._worker.close()

    def _progress(self, done: int, total: int | None) -> None:
        if self._cancelled.is_set():
            raise MakingCancelled
        self._images = done, total

    def _run(self, make: Make) -> MadeRecording | str:
        try:
            return make(self._progress)
        except MakingCancelled:
            return f"{self._label} was cancelled; nothing was written."
        except LtvnError as error:
            return str(error)
        except Exception as error:
            logger.exception("%s failed", self._label)
            return f"{self._label} failed ({type(error).__name__}: {error}). The log on the console says more."

    def _ended(self, result: MadeRecording | str) -> None:
        self._result = result
