"""The images of the nodes on show, ready to be compared: those of the live map, or a recording's, read bit by bit.

Owns what of a recording is read and encoded already. Compares nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import NodeId, Observation
from ltvn_viz.debugger.context import DebugContext, PredictorView

_AT_ONCE = 24
"""Images read between two pictures of the page."""
MAX_NODES = 2000
"""So many nodes of a recording are compared, so that a long one fits into memory."""


class NodeImageLoader:
    """Encoded images by node."""

    def __init__(self) -> None:
        """Begin with none."""
        self._run: Any = None
        self._keyframes: KeyframeStore | None = None
        self._read: set[NodeId] = set()
        self._reading: tuple[Any, ...] | None = None

    def load(self, context: DebugContext) -> tuple[KeyframeStore, int]:
        """Return views, to be touched in the worker's thread alone, and how many nodes are still to be read."""
        if context.live_map is not None:
            return context.live_map.keyframes, 0
        run = context.name, context.predictor.fingerprint
        if run != self._run or self._keyframes is None:
            self._run, self._keyframes = run, KeyframeStore(context.predictor)
            self._read, self._reading = set(), None
        missing = [node for node in list(context.graph.nodes)[:MAX_NODES] if node not in self._read]
        if missing and self._is_free(context):
            self._read_on(context, self._keyframes, missing[:_AT_ONCE])
        return self._keyframes, len(missing)

    def _is_free(self, context: DebugContext) -> bool:
        return self._reading is None or context.in_background(self._reading, _nothing) is not None

    def _read_on(self, context: DebugContext, keyframes: KeyframeStore, nodes: Sequence[NodeId]) -> None:
        self._read.update(nodes)
        seen = [picture for picture in map(context.observation, nodes) if picture is not None]
        self._reading = ("sights", *self._run, len(self._read))
        context.in_background(self._reading, _added(keyframes, seen, context.view))


def _added(keyframes: KeyframeStore, seen: Sequence[Observation], view: PredictorView) -> Callable[[], bool]:
    def add() -> bool:
        keyframes.add([image for image in map(view.of, seen) if image is not None])
        return True

    return add


def _nothing() -> bool:
    return True
