"""One measured budget, and how to time. Owns no budget."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Measurement:
    """A number against its budget."""

    name: str
    value: float
    unit: str
    budget: float
    better: Literal["lower", "higher"]
    met: bool


def measured(
    name: str, value: float, unit: str, *, at_most: float | None = None, at_least: float | None = None
) -> Measurement:
    """Compare a value with its one budget."""
    if at_most is not None:
        return Measurement(name, value, unit, at_most, "lower", value <= at_most)
    assert at_least is not None, "a measurement has a budget"
    return Measurement(name, value, unit, at_least, "higher", value >= at_least)


def seconds(job: Callable[[], object], repeats: int) -> float:
    """Return the median time of one call after a warm-up."""
    job()
    return statistics.median(seconds_once(job) for _ in range(repeats))


def seconds_once(job: Callable[[], object]) -> float:
    """Return the time of one call, for jobs too long to repeat."""
    start = time.perf_counter()
    job()
    return time.perf_counter() - start


def alternating(first: Callable[[], object], second: Callable[[], object], repeats: int) -> float:
    """Return how many times longer `second` takes than `first`, the median over pairs run in turn.

    Running them in turn lets both suffer alike from whatever else the machine does.
    """
    first()
    second()
    ratios = []
    for _ in range(repeats):
        begin = time.perf_counter()
        first()
        middle = time.perf_counter()
        second()
        ratios.append((time.perf_counter() - middle) / (middle - begin))
    return statistics.median(ratios)
