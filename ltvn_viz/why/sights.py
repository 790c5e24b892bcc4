"""The images of the nodes on show, ready to be compared: those of the live map, or a recording's, read bit by bit.

Owns what of a recording is read and encoded already. Compares nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any

from ltvn_core.graph.views import Views
from ltvn_core.types import NodeId, Observation
from ltvn_viz.why.case import Case

_AT_ONCE = 24
"""Images read between two pictures of the page."""
MOST = 2000
"""So many nodes of a recording are compared, so that a long one fits into memory."""


class Sights:
    """Encoded images by node."""

    def __init__(self) -> None:
        """Begin with none."""
        self._run: Any = None
        self._views: Views | None = None
        self._read: set[NodeId] = set()
        self._reading: tuple[Any, ...] | None = None

    def of(self, case: Case) -> tuple[Views, int]:
        """Return views, to be touched in the worker's thread alone, and how many nodes are still to be read."""
        if case.mapping is not None:
            return case.mapping.views, 0
        run = case.name, case.predictor.fingerprint
        if run != self._run or self._views is None:
            self._run, self._views = run, Views(case.predictor)
            self._read, self._reading = set(), None
        missing = [node for node in list(case.graph.nodes)[:MOST] if node not in self._read]
        if missing and self._is_free(case):
            self._read_on(case, self._views, missing[:_AT_ONCE])
        return self._views, len(missing)

    def _is_free(self, case: Case) -> bool:
        return self._reading is None or case.later(self._reading, _nothing) is not None

    def _read_on(self, case: Case, views: Views, nodes: Sequence[NodeId]) -> None:
        self._read.update(nodes)
        seen = [picture for picture in map(case.picture, nodes) if picture is not None]
        self._reading = ("sights", *self._run, len(self._read))
        case.later(self._reading, _added(views, seen))


def _added(views: Views, seen: Sequence[Observation]) -> Callable[[], bool]:
    def add() -> bool:
        views.add(seen)
        return True

    return add


def _nothing() -> bool:
    return True
