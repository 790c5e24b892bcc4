"""Makes the case that tools look at, of the live run or of an open recording.

Owns the index of the run's events, and how often that of a growing run is looked at anew.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ltvn_core.analysis.growing import GrowingTimeline
from ltvn_core.analysis.timeline import Timeline as Index
from ltvn_core.errors import LtvnError
from ltvn_core.types import FrameId, Observation
from ltvn_viz.replay import Replay
from ltvn_viz.timeline import Moment, Timeline
from ltvn_viz.why.case import Case
from ltvn_viz.why.later import Later
from ltvn_viz.why.tool import ToolName

if TYPE_CHECKING:
    from ltvn_viz.stage import Stage

_ANEW_EVERY_S = 1.0
"""A run that goes on is looked at once a second at most, because tools answer anew each time."""


class Cases:
    """Remembers the index of the run that tools look at."""

    def __init__(self, later: Later, clock: Callable[[], float] = time.monotonic) -> None:
        """Let tools compute slowly by `later`."""
        self._later, self._clock = later, clock
        self._run: Timeline | None = None
        self._growing = GrowingTimeline()
        self._index = self._growing.timeline()
        self._due = float("-inf")

    def of(self, stage: "Stage", moment: Moment) -> Case:
        """Return the case of what the page shows."""
        activity = stage.activity
        replay = activity if isinstance(activity, Replay) else None
        run, index = self.indexed(stage)
        return Case(
            name="" if replay is None else replay.name,
            scene=stage.scene if replay is None else replay.scene,
            start_s=run.start_s,
            moment=moment,
            step=run.step_at(moment.stamp),
            timeline=index,
            pose=run.pose,
            picture=_live_picture(stage) if replay is None else replay.picture,
            method=stage.mapping.method,
            predictor=stage.mapping.predictor,
            weights=stage.mapping.fingerprint if replay is None else replay.weights,
            system="" if replay is None else replay.system,
            mapping=stage.mapping if replay is None else None,
            live=stage.live.timeline,
            later=self._later,
            library=stage.library,
            rerun=stage.rerun,
            view=stage.viewpoint() if stage.inspector.shown.tool is ToolName.SHARE else None,
        )

    def anew(self) -> None:
        """Index a growing run at once, because a person waits to see what was just changed."""
        self._due = float("-inf")

    def indexed(self, stage: "Stage") -> tuple[Timeline, Index]:
        """Return the run that the page shows and its index, which may lack what happened just now."""
        run = stage.activity.timeline if isinstance(stage.activity, Replay) else stage.live.timeline
        if run is not self._run:
            self._run, self._growing = run, GrowingTimeline()
            self._index = self._growing.timeline()
            self.anew()
        if len(run.events) != len(self._growing) and self._clock() > self._due:
            for stamped in run.events[len(self._growing) :]:
                self._growing.take(stamped)
            self._index, self._due = self._growing.timeline(), self._clock() + _ANEW_EVERY_S
        return run, self._index


def _live_picture(stage: "Stage") -> Callable[[FrameId], Observation | None]:
    def picture(frame: FrameId) -> Observation | None:
        if stage.live.seen is not None and stage.live.seen.step == frame:
            return stage.live.seen
        try:
            return stage.mapping.views.observation(frame)
        except LtvnError:
            return None

    return picture
