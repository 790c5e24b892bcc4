"""Goes to another moment of what the page shows: of a recording, or of the live run so far.

Owns the way from event to event. Where the events are is `ltvn_core.analysis.timeline`.
"""

from ltvn_core.analysis.timeline_records import Instant, MarkKind
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.timeline.adjacent_moments import adjacent_instant, adjacent_mark
from ltvn_viz.timeline.breakpoint_monitor import STAMP_EPSILON_S


def seek(state: AppState, time_s: float) -> None:
    """Show the world so many seconds after the beginning; live, the end means now."""
    if isinstance(state.activity, Playback):
        state.activity.seek(time_s)
        return
    run = state.live.timeline
    stamp = run.start_s + time_s
    state.shown_stamp = stamp if stamp < run.end_s else None


def seek_mark(state: AppState, kind: MarkKind | None, *, forwards: bool) -> None:
    """Show the next moment with a mark of a kind, or with any event for None, or the last one before."""
    if isinstance(state.activity, Playback):
        state.activity.play(playing=False)
    run = state.shown_run
    at = _instant(state)
    if kind is None:
        found = adjacent_instant(run, at, forwards=forwards)
    else:
        mark = adjacent_mark(run, at, kind, forwards=forwards)
        found = None if mark is None else mark.instant
    if found is not None:
        seek(state, found.stamp - run.start_s + STAMP_EPSILON_S)
    elif forwards and not isinstance(state.activity, Playback):
        state.shown_stamp = None
    else:
        thing = "query" if kind is MarkKind.QUERY_START else kind or "event"
        state.say(f"There is no {thing} {'after' if forwards else 'before'} this moment.")


def _instant(state: AppState) -> Instant:
    run = state.shown_run
    if isinstance(state.activity, Playback):
        stamp = state.activity.stamp
    else:
        stamp = run.end_s if state.shown_stamp is None else state.shown_stamp
    return run.instant_at(stamp)
