"""Workers of an evaluation: the cores of this machine, or a Dask cluster, through joblib.

Jobs share only files, so on a cluster the folder of the evaluation must have the same path on all machines. A worker
with another version, with other weights or without that folder refuses its job. Without a cluster engine, the command
can run on each machine with a part of the work.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias, TypeVar
from uuid import uuid4

from joblib import Parallel, cpu_count, delayed, parallel_config

from ltvn_core.errors import EngineError, OptionError

Work = TypeVar("Work")


@dataclass(frozen=True, slots=True)
class Part:
    """One of several disjoint shares of the work, of nearly the same size.

    Consecutive items of the list of work are mostly in the same share, because they need the same maps.
    """

    number: int = 1
    """Number of the share, from 1 to `count`."""
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise OptionError(f"--part must be I/N with I from 1 to N, got {self}.")

    def __str__(self) -> str:
        """Return the part in the format of the option."""
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> "Part":
        """Read `I/N`; an empty text is all of the work. Raises OptionError."""
        if not text:
            return WHOLE
        if not (found := re.fullmatch(r"(\d{1,6})/(\d{1,6})", text.strip())):
            raise OptionError(f"--part must be I/N, such as 3/16 for part 3 of 16, got {text!r:.40}.")
        return cls(int(found[1]), int(found[2]))

    @property
    def label(self) -> str:
        """The part as it is written in the names of files."""
        return f"part-{self.number}-of-{self.count}"

    def of(self, work: Sequence[Work]) -> list[Work]:
        """Return the share of a list, in its order."""
        first, until = ((number * len(work)) // self.count for number in (self.number - 1, self.number))
        return list(work[first:until])


WHOLE = Part()
"""All of the work."""


Workers: TypeAlias = Callable[[Iterable[Any]], Iterable[Any]]
"""Runs joblib's delayed calls and yields their results in any order."""

_WORKERS_START_S = 300.0
"""Time to wait for the start of workers, in seconds; long, because the machine may be busy."""


@contextmanager
def workers(processes: int | None, cluster: str | None, folder: Path) -> Iterator[Workers]:
    """Yield a function that runs joblib's delayed calls, and yields their results as they finish.

    Args:
        processes: Number of processes on this machine; None uses all cores.
        cluster: A Dask cluster instead: `tcp://HOST:PORT`, or `local:N` for N workers on this machine.
        folder: Folder of the jobs' files.

    Raises:
        OptionError: There is no such cluster, or the package that it needs is not installed.
        EngineError: During a run, a worker differs from this machine.
    """
    if cluster is not None:
        with ExitStack() as stack:
            run = stack.enter_context(_on_cluster(cluster))
            stamp = stack.enter_context(_stamped(folder))
            yield lambda jobs: run(delayed(_run_alike)(stamp, *job) for job in jobs)
        return
    count = cpu_count() if processes is None else processes
    if count < 1:
        raise OptionError(f"--processes must be 1 or more, got {count}.")
    # One thread each: several processes use the cores better than several threads in one.
    backend = {"backend": "loky", "inner_max_num_threads": 1} if count > 1 else {"backend": "sequential"}
    with parallel_config(**backend), Parallel(n_jobs=count, return_as="generator_unordered") as parallel:
        yield lambda jobs: _each_here(work) if len(work := list(jobs)) == 1 else parallel(work)


def _each_here(work: Iterable[Any]) -> Iterator[Any]:
    """Do a single job in this process; another would have to load the program first."""
    for function, arguments, options in work:
        yield function(*arguments, **options)


@contextmanager
def _on_cluster(address: str) -> Iterator[Workers]:
    if not re.fullmatch(r"(tcp|tls)://.+|local:[1-9]\d{0,3}", address):
        raise OptionError(f"--cluster must be tcp://HOST:PORT, or local:N for N workers, got {address!r}.")
    try:
        dask: Any = import_module("dask.distributed")  # The type hints of dask describe its asynchronous interface.
    except ModuleNotFoundError as missing:
        raise OptionError(f'--cluster {address} needs {missing.name}: pip install "distributed"') from missing
    with ExitStack() as stack:
        if address.startswith("local:"):
            count = int(address.removeprefix("local:"))
            # Any free port, so that two clusters can run on one machine.
            local = dask.LocalCluster(count, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0")
            address = stack.enter_context(local).scheduler_address
        try:
            stack.enter_context(dask.Client(address))
        except OSError as error:
            raise OptionError(f"No cluster answers at {address}: {error}") from error
        stack.enter_context(parallel_config(backend="dask", wait_for_workers_timeout=_WORKERS_START_S))
        yield stack.enter_context(Parallel(return_as="generator_unordered"))


@dataclass(frozen=True, slots=True)
class _Stamp:
    """Properties that a worker must share with the machine that sends it jobs."""

    version: str
    weights: str
    """Fingerprint of the shipped weights."""
    token: Path
    """A file in the shared folder."""


@contextmanager
def _stamped(folder: Path) -> Iterator[_Stamp]:
    folder.mkdir(parents=True, exist_ok=True)
    token = folder.absolute() / f".shared-{uuid4().hex[:8]}"
    token.touch()
    try:
        yield _Stamp(version("ltvn"), _shipped_fingerprint(), token)
    finally:
        token.unlink(missing_ok=True)


@cache
def _shipped_fingerprint() -> str:
    from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
    from ltvn_core.network.weights_file import weights_fingerprint

    return weights_fingerprint(SHIPPED_WEIGHTS)


def _run_alike(stamp: _Stamp, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Run a job if the worker matches the machine that sent it. Raises EngineError otherwise."""
    if not stamp.token.exists():
        raise EngineError(
            f"A worker does not see the folder {stamp.token.parent}; on a cluster all machines must have it at the "
            "same path. Name a shared --folder."
        )
    if (here := version("ltvn")) != stamp.version:
        raise EngineError(f"A worker has version {here} of ltvn, this machine {stamp.version}. Install the same one.")
    if (weights := _shipped_fingerprint()) != stamp.weights:
        raise EngineError(f"A worker has the weights {weights}, this machine {stamp.weights}. Install the same ones.")
    return function(*args, **kwargs)
