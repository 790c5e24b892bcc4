"""Makes what the debugger's questions look at, of the live run or of an open recording.

Owns how often answers about all events of a growing run are given anew.
"""

import time
from collections.abc import Callable

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import LtvnError
from ltvn_core.graph.presence.edge_presence import FilteredPresence
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.systems.maintenance import recorded_filter
from ltvn_core.types import FrameId, Observation
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.timeline.run_moment import RunMoment

_COUNT_EVERY_S = 1.0
"""The events of a run that goes on are counted once a second at most, because questions are answered anew each time."""


class DebugContextBuilder:
    """Remembers how many events answers take in."""

    def __init__(self, in_background: BackgroundCache, clock: Callable[[], float] = time.monotonic) -> None:
        """Let questions compute slowly by `in_background`."""
        self._in_background = in_background
        self._clock = clock
        self._run: Timeline | None = None
        self._known_events = 0
        self._due = float("-inf")

    def build(self, state: AppState, moment: RunMoment) -> DebugContext:
        """Return what questions may look at when the page shows `moment`."""
        replay = state.activity if isinstance(state.activity, Playback) else None
        run = state.shown_run
        compared = None if replay is None else replay.method
        return DebugContext(
            name="" if replay is None else replay.name,
            scene=state.scene if replay is None else replay.scene,
            start_s=run.start_s,
            moment=moment,
            step=run.instant_at(moment.stamp).step,
            timeline=run,
            known_events=self._count(run),
            observation=_live_observation(state) if replay is None else replay.observation,
            camera=state.live.robot.spec.camera if replay is None else replay.camera_model,
            method=state.live_map.system.method if compared is None else compared.method,
            predictor=state.live_map.predictor if compared is None else compared.predictor,
            weights=state.live_map.fingerprint if replay is None else replay.weights,
            system=state.live_map.system.name if replay is None else replay.system,
            presence_filter=_live_filter(state) if replay is None else recorded_filter(replay.maintenance),
            live_map=state.live_map if replay is None else None,
            live=state.live.timeline,
            in_background=self._in_background,
            library=state.library,
            rerun=state.rerun,
            viewpoint=state.viewpoint() if state.debugger.shown.question is QuestionName.SHARE else None,
        )

    def count_now(self) -> None:
        """Take in all events at once, because a person waits to see what was just changed."""
        self._due = float("-inf")

    def _count(self, run: Timeline) -> int:
        if run is not self._run or (len(run.events) != self._known_events and self._clock() > self._due):
            self._run = run
            self._known_events = len(run.events)
            self._due = self._clock() + _COUNT_EVERY_S
        return self._known_events


def _live_filter(state: AppState) -> PresenceFilter | None:
    presence = state.live_map.system.presence
    return presence.presence_filter if isinstance(presence, FilteredPresence) else None


def _live_observation(state: AppState) -> Callable[[FrameId], Observation | None]:
    def observation(frame: FrameId) -> Observation | None:
        if state.live.observation is not None and state.live.observation.step == frame:
            return state.live.observation
        try:
            return state.live_map.keyframes.observation(frame)
        except LtvnError:
            return None

    return observation
