"""Rebuilds a map from all images in memory, while the robot stands still.

Owns progress and cancelling. The old map stays until the new one is complete.
"""

import threading
from collections.abc import Callable, Sequence

from ltvn_core.findings import Finding
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import GraphChanged, Note
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes.commands import Mode

Rebuild = Callable[[Callable[[int, int], None]], Sequence[GraphDelta]]
"""Builds the map and returns every change from the old map. Its argument gets the numbers of finished and of all
images."""


class MapBuildingCancelled(Exception):
    """A person cancelled the building of the map."""


class MapBuilding:
    """One run of Algorithm 1."""

    mode = Mode.BUILDING

    def __init__(
        self,
        live: LiveRun,
        worker: Worker,
        rebuild: Rebuild,
        then: Callable[[], None] = lambda: None,
        *,
        findings: Callable[[], Sequence[Finding]],
    ) -> None:
        """Stop the robot and start building in the worker's thread; `then` runs in the session's thread after success.

        After success, `findings` returns the doubtful properties of the new map.
        """
        self._live = live
        self._then = then
        self._findings = findings
        self._cancelled = threading.Event()
        self._done = 0
        self._total = 0
        self.over = False
        live.robot.stop()
        worker.submit(lambda: self._run(rebuild), self._built)

    @property
    def work(self) -> JobProgress:
        """Progress of the building."""
        return JobProgress("Building the map", self._done, self._total)

    def cancel(self) -> None:
        """Cancel the building at the next image and keep the old map."""
        self._cancelled.set()

    def tick(self) -> None:
        """Do nothing, because the worker builds the map."""

    def _run(self, rebuild: Rebuild) -> Sequence[GraphDelta] | None:
        try:
            return rebuild(self._progress)
        except MapBuildingCancelled:
            return None

    def _progress(self, done: int, total: int) -> None:
        if self._cancelled.is_set():
            raise MapBuildingCancelled
        self._done = done
        self._total = total

    def _built(self, deltas: Sequence[GraphDelta] | None) -> None:
        for delta in deltas or ():
            self._live.emit(GraphChanged(delta))
        if deltas is not None:
            for finding in self._findings():
                self._live.emit(Note(str(finding), finding.severity))
        self.over = True
        if deltas is not None:
            self._then()
