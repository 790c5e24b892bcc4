"""Workers of an evaluation: the cores of this machine, or an existing Ray or Dask cluster, through joblib.

Jobs share nothing but files, so on a cluster the folder of the evaluation must have the same path on all machines.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from joblib import Parallel, cpu_count, parallel_config

from ltvn_core.errors import OptionError

Workers: TypeAlias = Callable[[Iterable[Any]], Iterable[Any]]
"""Runs joblib's delayed calls and yields their results in any order."""


@contextmanager
def workers(processes: int | None, cluster: str | None) -> Iterator[Workers]:
    """Yield something that runs joblib's delayed calls, and hands their results back as they come.

    `processes` None takes all cores. `cluster` is `ray://HOST:PORT` (Ray) or `tcp://HOST:PORT` (Dask). Raises
    OptionError for another address, and where the package that it needs is not installed.
    """
    if cluster is not None:
        with _on_cluster(cluster), Parallel(return_as="generator_unordered") as parallel:
            yield parallel
        return
    count = cpu_count() if processes is None else processes
    if count < 1:
        raise OptionError(f"--workers must be 1 or more, got {count}.")
    # One thread each: several processes use the cores better than several threads in one.
    backend = {"backend": "loky", "inner_max_num_threads": 1} if count > 1 else {"backend": "sequential"}
    with parallel_config(**backend), Parallel(n_jobs=count, return_as="generator_unordered") as parallel:
        yield parallel


@contextmanager
def _on_cluster(address: str) -> Iterator[None]:
    scheme = address.partition("://")[0]
    if scheme == "ray":
        with _needs("ray", address):
            import ray  # pyright: ignore[reportMissingImports]
            from ray.util.joblib import register_ray  # pyright: ignore[reportMissingImports]

        ray.init(address)
        register_ray()
        with parallel_config(backend="ray"):
            yield
    elif scheme in ("tcp", "tls"):
        with _needs("distributed", address):
            from dask.distributed import Client  # pyright: ignore[reportMissingImports]

        with Client(address), parallel_config(backend="dask"):
            yield
    else:
        raise OptionError(f"--cluster must be ray://HOST:PORT or tcp://HOST:PORT (Dask), got {address!r}.")


@contextmanager
def _needs(package: str, address: str) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as missing:
        raise OptionError(f"--cluster {address} needs {missing.name}: pip install {package}") from missing
