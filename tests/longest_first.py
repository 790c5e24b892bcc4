"""Runs the modules that take long first, by the times of an earlier run, and prints which took longest in this one."""

from collections import Counter
from pathlib import Path

import pytest
from xdist.scheduler.loadscope import LoadScopeScheduling

TIMES = Path(__file__).parent / "module_seconds.txt"
"""Seconds and path of each module of `LISTED_S` and more; `make test-times` writes it."""
LISTED_S = 2.0
_NEW_S = 5.0
"""Time of a module with a slow test that is not listed."""
BROWSER = "tests/browser/"
"""Where the tests are that need a browser."""
_SHOWN = 10


class ModuleTimes:
    """A pytest plug-in that adds up what the tests of each module take, with their fixtures."""

    def __init__(self, *, are_kept: bool) -> None:
        """Measure, and write the times down at the end if `are_kept`."""
        self._are_kept = are_kept
        self._seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of a test."""
        self._seconds[report.nodeid.partition("::")[0]] += report.duration  # pyright: ignore[reportArgumentType]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the modules that took longest, where there are many."""
        if len(self._seconds) > _SHOWN:
            total = sum(self._seconds.values())
            terminalreporter.section(f"{_SHOWN} longest of {len(self._seconds)} modules, {total:.0f} s in all")
            for module, seconds in self._seconds.most_common(_SHOWN):
                terminalreporter.line(f"{seconds:6.1f} s  {module}")
        if self._are_kept:
            listed = [f"{s:6.1f}  {module}\n" for module, s in self._seconds.most_common() if s >= LISTED_S]
            TIMES.write_text("".join(listed), encoding="utf-8")


class OneBrowser(LoadScopeScheduling):
    """Gives each process one module after the other, and all modules with a browser to the same process.

    A page that is drawn in software takes a whole core, so two browsers at once only slow each other down.
    """

    def _split_scope(self, nodeid: str) -> str:
        return BROWSER if nodeid.startswith(BROWSER) else super()._split_scope(nodeid)


def longest_first(items: list[pytest.Item]) -> None:
    """Sort tests by the measured time of their module, those with a browser first of all, so that in the end no process
    waits for another one."""
    seconds = _measured()
    of_module: dict[str, float] = {}
    for item in items:
        usual = _NEW_S if item.get_closest_marker("slow") else 0.0
        of_module[_module(item)] = max(seconds.get(_module(item), usual), of_module.get(_module(item), 0.0))
    items.sort(key=lambda item: (not item.nodeid.startswith(BROWSER), -of_module[_module(item)]))


def _module(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]


def _measured() -> dict[str, float]:
    if not TIMES.exists():
        return {}
    rows = (line.split() for line in TIMES.read_text(encoding="utf-8").splitlines())
    return {module: float(seconds) for seconds, module in rows}
