"""Reads a script over time, and puts off what cannot be yet."""

from collections.abc import Iterator

from ltvn_core.simulation.changes.world_script import TimedChange, WorldScript
from ltvn_core.worlds import world_change as w


class ScriptReader:
    """One script, and how far it has come."""

    def __init__(self, script: WorldScript) -> None:
        """Begin before the first change."""
        self._script = script
        self._next = 0
        self._waiting: dict[str, w.WorldChange] = {}
        """What was put off, by what it is about."""

    def due(self, time_s: float) -> Iterator[TimedChange]:
        """Yield what was put off, once more, and then what the script says until now; each may be put off again."""
        waiting, self._waiting = self._waiting, {}
        for change in waiting.values():
            yield TimedChange(time_s, change)
        changes = self._script.changes
        while self._next < len(changes) and changes[self._next].at_s <= time_s:
            self._next += 1
            timed = changes[self._next - 1]
            self.forget(timed.change)
            yield timed

    def put_off(self, change: w.WorldChange) -> None:
        """Yield a change again the next time."""
        self._waiting[w.subject(change)] = change

    def forget(self, change: w.WorldChange) -> None:
        """Forget what was put off about the same thing, because this change comes later."""
        self._waiting.pop(w.subject(change), None)
