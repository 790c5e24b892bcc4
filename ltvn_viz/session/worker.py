"""Runs long jobs in one thread and returns their results to the session's thread.

The worker's thread owns map and model, so jobs run strictly one after another; their results are handled in the
session's thread, in the same order.
"""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, wait
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")


class _Job(NamedTuple):
    future: Future[Any]
    then: Callable[[Any], None]
    otherwise: Callable[[], None]


class Worker:
    """A queue of jobs, each with a follow-up."""

    def __init__(self, executor: Executor) -> None:
        """Run jobs on `executor`, which must have a single thread."""
        self._executor = executor
        self._jobs: deque[_Job] = deque()

    @property
    def pending(self) -> int:
        """Number of jobs whose results are not handled yet."""
        return len(self._jobs)

    def submit(
        self, job: Callable[[], T], then: Callable[[T], None], *, otherwise: Callable[[], None] = lambda: None
    ) -> None:
        """Run `job` in the worker's thread and, from `collect`, `then` with its result, or `otherwise` if it raised."""
        self._jobs.append(_Job(self._executor.submit(job), then, otherwise))

    def collect(self) -> None:
        """Handle the results of all finished jobs; raises the error of a job, once."""
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.popleft()
            if job.future.exception() is not None:
                job.otherwise()
            job.then(job.future.result())

    def settle(self) -> None:
        """Wait for all jobs and handle their results; raises the error of a job."""
        while self._jobs:
            wait([self._jobs[0].future])
            self.collect()

    def wait(self, at_most_s: float) -> None:
        """Wait for the oldest job, at most `at_most_s` seconds; `collect` handles its result."""
        if self._jobs:
            wait([self._jobs[0].future], at_most_s)

    def close(self) -> None:
        """Wait for the running job and drop all others."""
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._jobs = deque(job for job in self._jobs if not job.future.cancelled())
