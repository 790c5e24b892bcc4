"""What a campaign tries, how long at most, and what comes of it. Owns the table that is printed at the end."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field


@dataclass
class Tally:
    """The counts of one campaign. What fails is noted, and the campaign goes on."""

    name: str
    asked: int
    """How many attempts it would like to make."""
    ends_s: float
    """When it ends on the monotonic clock, however many were made."""
    done: int = 0
    findings: dict[str, float] = field(default_factory=dict)
    """What was counted or measured -> how much."""
    failures: list[str] = field(default_factory=list)
    _lock: threading.RLock = field(default_factory=threading.RLock, repr=False)

    @property
    def is_over(self) -> bool:
        """Tell whether the time is over."""
        return time.monotonic() >= self.ends_s

    def batches(self, size: int = 1) -> Iterator[range]:
        """Yield the numbers of all attempts in batches, the first of them in any case and no more when time is over."""
        for first in range(0, self.asked, size):
            if first and self.is_over:
                return
            yield range(first, min(first + size, self.asked))

    def spread(self, attempt: Callable[[range], None], *, batch: int = 1, side_by_side: int = 1) -> None:
        """Attempt all batches, some of them at the same time."""
        batches = self.batches(batch)

        def work() -> None:
            while (numbers := self._next(batches)) is not None:
                try:
                    attempt(numbers)
                except Exception as error:  # Whatever it is, the other attempts count too.
                    self.fail(f"{numbers}: {error!r}")

        with ThreadPoolExecutor(side_by_side) as pool:
            for each in [pool.submit(work) for _ in range(side_by_side)]:
                each.result()

    def add(self, done: int = 0, **findings: float) -> None:
        """Add to the counts."""
        with self._lock:
            self.done += done
            for what, much in findings.items():
                self.findings[what] = self.findings.get(what, 0) + much

    def most(self, **findings: float) -> None:
        """Keep the largest of what was measured."""
        with self._lock:
            for what, much in findings.items():
                self.findings[what] = max(self.findings.get(what, much), much)

    def fail(self, why: str) -> None:
        """Note something that must not be."""
        with self._lock:
            self.failures.append(why)

    def _next(self, batches: Iterator[range]) -> range | None:
        with self._lock:
            return next(batches, None)


def table(tallies: Sequence[Tally]) -> str:
    """Return the counts of all campaigns, a line each."""
    head = ("campaign", "asked", "done", "failed", "found")
    rows = [head, *((t.name, f"{t.asked:,}", f"{t.done:,}", f"{len(t.failures):,}", _found(t)) for t in tallies)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head) - 1)]
    return "\n".join(_line(row, widths) for row in rows)


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    name, *counts = (cell.rjust(width) for cell, width in zip(row, widths, strict=False))
    return "  ".join([name.strip().ljust(widths[0]), *counts, row[-1]])


def _found(tally: Tally) -> str:
    return ", ".join(f"{what.replace('_', ' ')} {much:,.6g}" for what, much in tally.findings.items())
