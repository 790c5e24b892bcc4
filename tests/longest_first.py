"""Runs the modules that take long first, by the times of an earlier run, and prints which took longest in this one."""

from collections import Counter
from pathlib import Path

import pytest

TIMES = Path(__file__).parent / "module_seconds.txt"
"""Seconds and path of each module of `LISTED_S` and more; `make test-times` writes it."""
LISTED_S = 2.0
_NEW_S = 5.0
"""Time of a module with a browser or slow test that is not listed."""
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
        """Print the modules that took longest."""
        total = sum(self._seconds.values())
        terminalreporter.section(f"{_SHOWN} longest of {len(self._seconds)} modules, {total:.0f} s in all")
        for module, seconds in self._seconds.most_common(_SHOWN):
            terminalreporter.line(f"{seconds:6.1f} s  {module}")
        if self._are_kept:
            listed = [f"{s:6.1f}  {module}\n" for module, s in self._seconds.most_common() if s >= LISTED_S]
            TIMES.write_text("".join(listed), encoding="utf-8")


def longest_first(items: list[pytest.Item]) -> None:
    """Sort tests so that no process waits for another one in the end: modules by measured time, the longest first."""
    seconds = _measured()
    of_module: dict[str, float] = {}
    for item in items:
        module = item.nodeid.partition("::")[0]
        is_long = any(item.get_closest_marker(marker) for marker in ("browser", "slow"))
        of_module[module] = max(seconds.get(module, _NEW_S if is_long else 0.0), of_module.get(module, 0.0))
    items.sort(key=lambda item: -of_module[item.nodeid.partition("::")[0]])


def _measured() -> dict[str, float]:
    if not TIMES.exists():
        return {}
    rows = (line.split() for line in TIMES.read_text(encoding="utf-8").splitlines())
    return {module: float(seconds) for seconds, module in rows}
