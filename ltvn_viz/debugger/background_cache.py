"""Background cache: computes each slow answer once, in the worker's thread, while the page stays responsive.

Owns the pending and the finished answers. A computation must not use data that the session's thread changes.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeAlias

from ltvn_core.errors import LtvnError

_KEPT = 32
_LEFT = object()
"""Placeholder for the answer to a question that was abandoned before its computation."""
_LOG = logging.getLogger(__name__)


Submit: TypeAlias = Callable[[Callable[[], Any], Callable[[Any], None]], None]
"""Runs a job later, and then its follow-up with the job's result."""


class BackgroundCache:
    """A cache of answers by their questions."""

    def __init__(self, submit: Submit, on_answer: Callable[[], None]) -> None:
        """Compute by `submit`; `on_answer` is called in the session's thread when there is a new answer."""
        self._submit = submit
        self._on_answer = on_answer
        self._known: OrderedDict[Hashable, Any] = OrderedDict()
        self._asked: set[Hashable] = set()
        self._left: set[Hashable] = set()
        """Questions that were abandoned; their computations do not start any more."""

    def __call__(self, question: Hashable, compute: Callable[[], Any]) -> Any | None:
        """Return the answer to a question, or None while it is computed; raises the LtvnError of a failed
        computation."""
        if question in self._known:
            answer = self._known[question]
            if isinstance(answer, LtvnError):
                raise answer
            return answer
        self._left.discard(question)
        if question not in self._asked:
            self._asked.add(question)
            self._submit(
                lambda: _LEFT if question in self._left else _tried(compute),
                lambda answer: self._answered(question, answer),
            )
        return None

    def leave(self) -> None:
        """Abandon all pending questions."""
        self._left |= self._asked

    def _answered(self, question: Hashable, answer: Any) -> None:
        self._asked.discard(question)
        self._left.discard(question)
        if answer is _LEFT:
            self._on_answer()  # The person may have returned to the question after abandoning it.
            return
        self._known[question] = answer
        while len(self._known) > _KEPT:
            self._known.popitem(last=False)
        self._on_answer()


class LatestAnswer:
    """Computes one answer at a time, for questions that change faster than they are answered.

    While the map changes during a computation, the newest answer stays valid, and the worker has only one job.
    """

    def __init__(self) -> None:
        """Start without an answer."""
        self._asked: tuple[Hashable, Callable[[], Any]] | None = None
        self._newest: Any | None = None
        self._about: object = None

    def __call__(self, cache: BackgroundCache, question: Hashable, compute: Callable[[], Any]) -> Any | None:
        """Return the newest answer, or None before the first one; raises the LtvnError of a failed computation."""
        asked = self._asked or (question, compute)
        self._asked = None
        if (answer := cache(*asked)) is None:
            self._asked = asked
            return self._newest
        self._newest = answer
        return answer if asked[0] == question else self(cache, question, compute)

    @property
    def is_behind(self) -> bool:
        """Whether the last returned answer belongs to an earlier question, and the new one is being computed."""
        return self._asked is not None

    def about(self, subject: object) -> None:
        """Discard the old answer if it is about another subject, such as another run."""
        if subject != self._about:
            self._about = subject
            self.forget()

    def forget(self) -> None:
        """Discard the old answer, because the question is a different one now."""
        self._asked = self._newest = None


def _tried(compute: Callable[[], Any]) -> Any:
    try:
        return compute()
    except LtvnError as error:
        return error
    except Exception as error:
        # After any error, a question must not wait for its answer for ever.
        _LOG.exception("A question could not be answered")
        return LtvnError(f"This could not be answered: {error!r}")
