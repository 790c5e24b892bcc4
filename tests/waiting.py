"""How tests wait for what other threads, processes and browsers do. Owns how long they are given."""

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 240.0
"""So long may anything take on a machine that has other things to do; who waits for nothing fails after that."""

PATIENCE_MS = PATIENCE_S * 1000

_Answer = TypeVar("_Answer")


def _nap() -> None:
    time.sleep(0.02)


def until(
    ask: Callable[[], _Answer],
    *,
    patience_s: float = PATIENCE_S,
    meanwhile: Callable[[], object] = _nap,
    explain: Callable[[], object] = lambda: "",
) -> _Answer:
    """Ask until the answer is true, and return it; in between do something that lets time pass.

    Raises AssertionError with an explanation when it did not become true in time.
    """
    deadline = time.monotonic() + patience_s
    while not (answer := ask()):
        assert time.monotonic() < deadline, f"it never happened; at last: {explain()}"
        meanwhile()
    return answer
