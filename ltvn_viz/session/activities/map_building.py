"""Rebuilds a map from all images in memory, while the robot stands still.

The old map stays until the new one is complete.
"""

from collections.abc import Callable, Sequence

from ltvn_core.findings import Finding
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Note
from ltvn_viz.session.job import Job, Progress
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes.modes import Mode

Rebuild = Callable[[Progress], Sequence[GraphDelta]]
"""Builds the map and returns every change from the old map."""


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
        self._job = Job[Sequence[GraphDelta]](worker)
        self.over = False
        live.robot.stop()
        self._job.begin("Building the map", rebuild, self._built)

    @property
    def work(self) -> JobProgress:
        """Progress of the building."""
        return JobProgress(self._job.label, *self._job.images)

    def cancel(self) -> None:
        """Cancel the building at the next image and keep the old map."""
        self._job.cancel()

    def tick(self) -> None:
        """Do nothing, because the worker builds the map."""

    def _built(self) -> None:
        if self._job.error is not None:
            raise self._job.error
        self.over = True
        if (deltas := self._job.result) is None:
            return
        self._live.emit_changes(deltas)
        for finding in self._findings():
            self._live.emit(Note(str(finding), finding.severity))
        self._then()
