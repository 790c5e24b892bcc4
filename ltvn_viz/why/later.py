"""Slow answers: computed once each in the worker's thread, while the page goes on.

Owns what is under way and what is known. What is computed must touch nothing that the session's thread changes.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

from ltvn_viz.worker import Worker

_KEPT = 32


class Later:
    """Answers by their questions."""

    def __init__(self, worker: Worker, on_answer: Callable[[], None]) -> None:
        """Compute in `worker`; `on_answer` is called in the session's thread whenever there is something new."""
        self._worker, self._on_answer = worker, on_answer
        self._known: OrderedDict[Hashable, Any] = OrderedDict()
        self._asked: set[Hashable] = set()

    def __call__(self, question: Hashable, compute: Callable[[], Any]) -> Any | None:
        """Return the answer to a question, None as long as it is being computed."""
        if question in self._known:
            return self._known[question]
        if question not in self._asked:
            self._asked.add(question)
            self._worker.submit(compute, lambda answer: self._answered(question, answer))
        return None

    def _answered(self, question: Hashable, answer: Any) -> None:
        self._asked.discard(question)
        self._known[question] = answer
        while len(self._known) > _KEPT:
            self._known.popitem(last=False)
        self._on_answer()
