"""Makes the case that tools look at, of the live run or of an open recording.

Owns the index of the run's events, and how often that of a growing run is looked at anew.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ltvn_core.analysis.growing_timeline import GrowingTimeline
from ltvn_core.analysis.timeline import Timeline as Index
from ltvn_core.errors import LtvnError
from ltvn_core.types import FrameId, Observation
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import QuestionName
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.timeline.run_timeline import RunMoment, RunTimeline

if TYPE_CHECKING:
    from ltvn_viz.session.app_state import AppState

_REINDEX_EVERY_S = 1.0
"""A run that goes on is looked at once a second at most, because tools answer anew each time."""


class DebugContextBuilder:
    """Remembers the index of the run that tools look at."""

    def __init__(self, in_background: BackgroundCache, clock: Callable[[], float] = time.monotonic) -> None:
        """Let tools compute slowly by `in_background`."""
        self._later, self._clock = in_background, clock
        self._run: RunTimeline | None = None
        self._growing = GrowingTimeline()
        self._index = self._growing.timeline()
        self._due = float("-inf")

    def build(self, state: "AppState", moment: RunMoment) -> DebugContext:
        """Return the case of what the page shows."""
        activity = state.activity
        replay = activity if isinstance(activity, Playback) else None
        run, index = self.indexed(state)
        return DebugContext(
            name="" if replay is None else replay.name,
            scene=state.scene if replay is None else replay.scene,
            start_s=run.start_s,
            moment=moment,
            step=run.step_at(moment.stamp),
            timeline=index,
            pose=run.pose,
            observation=_live_observation(state) if replay is None else replay.observation,
            method=state.live_map.method,
            predictor=state.live_map.predictor,
            weights=state.live_map.fingerprint if replay is None else replay.weights,
            system="" if replay is None else replay.system,
            live_map=state.live_map if replay is None else None,
            live=state.live.timeline,
            in_background=self._later,
            library=state.library,
            rerun=state.rerun,
            viewpoint=state.viewpoint() if state.inspector.shown.question is QuestionName.SHARE else None,
        )

    def reindex_now(self) -> None:
        """Index a growing run at once, because a person waits to see what was just changed."""
        self._due = float("-inf")

    def indexed(self, state: "AppState") -> tuple[RunTimeline, Index]:
        """Return the run that the page shows and its index, which may lack what happened just now."""
        run = state.activity.timeline if isinstance(state.activity, Playback) else state.live.timeline
        if run is not self._run:
            self._run, self._growing = run, GrowingTimeline()
            self._index = self._growing.timeline()
            self.reindex_now()
        if len(run.events) != len(self._growing) and self._clock() > self._due:
            for stamped in run.events[len(self._growing) :]:
                self._growing.take(stamped)
            self._index, self._due = self._growing.timeline(), self._clock() + _REINDEX_EVERY_S
        return run, self._index


def _live_observation(state: "AppState") -> Callable[[FrameId], Observation | None]:
    def observation(frame: FrameId) -> Observation | None:
        if state.live.observation is not None and state.live.observation.step == frame:
            return state.live.observation
        try:
            return state.live_map.keyframes.observation(frame)
        except LtvnError:
            return None

    return observation
