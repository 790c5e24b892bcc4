"""One slow question at a time: while it is being answered only the newest of those that follow is kept.

Owns that a tool which looks at every moment never queues up work. Computing is `later`.
"""

from collections.abc import Callable, Hashable
from typing import Any

from ltvn_viz.why.later import Later


class Newest:
    """Remembers the last answer until there is a newer one."""

    def __init__(self) -> None:
        """Begin without a question."""
        self._asked: Hashable = None
        self._compute: Callable[[], Any] | None = None
        self._answered: Hashable = None
        self._answer: Any = None

    def __call__(self, later: Later, question: Hashable, compute: Callable[[], Any]) -> Any | None:
        """Return the newest answer, which may be to an older question; None before the first. `compute` never raises
        and never returns None.
        """
        self._collect(later)
        if self._compute is None and question != self._answered:
            self._asked, self._compute = question, compute
            self._collect(later)
        return self._answer

    def _collect(self, later: Later) -> None:
        answer = None if self._compute is None else later(self._asked, self._compute)
        if answer is not None:
            self._answered, self._answer, self._compute = self._asked, answer, None
