"""Seeking and playing: moves the current time of a recording, or of the live run so far.

Owns stepping from event to event, and looking back during a run. `ltvn_core.analysis.timeline` knows the events.
"""

from ltvn_core.analysis.timeline import adjacent_instant, adjacent_mark
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.timeline.breakpoint_monitor import STAMP_EPSILON_S

LEAST_SPEED, MOST_SPEED = 25, 800
"""Limits of the playing speed, in percent."""


def seek(state: AppState, time_s: float) -> None:
    """Show the state at a time in seconds after the beginning; in a live run, the end means now."""
    if isinstance(state.activity, Playback):
        state.activity.seek(time_s)
        return
    run = state.live.timeline
    stamp = run.start_s + time_s
    state.shown_stamp = stamp if stamp < state.live.now_s else None
    state.plays_past = state.plays_past and state.shown_stamp is not None


def seek_ms(state: AppState, time_ms: int) -> None:
    """Show the state at a time in milliseconds after the beginning."""
    seek(state, time_ms / 1000)


def seek_by(state: AppState, seconds: float) -> None:
    """Show the state at a later time (positive), or an earlier time (negative), by a number of seconds."""
    seek(state, _shown_stamp(state) - state.shown_run.start_s + seconds)


def set_speed(state: AppState, percent: int) -> None:
    """Set the playback speed, within its limits."""
    state.play_speed = min(max(percent, LEAST_SPEED), MOST_SPEED) / 100


def show_now(state: AppState) -> None:
    """End a look back at the live run; this does not change a recording, which has no present."""
    state.shown_stamp = None
    state.plays_past = False


def play_or_hold(state: AppState) -> None:
    """Play or pause the recording or the look back."""
    if isinstance(state.activity, Playback):
        state.activity.play(playing=not state.activity.playing)
    elif state.shown_stamp is None:
        state.say("This is now. Click into the timeline to look back, then play what happened.")
    else:
        state.plays_past = not state.plays_past


def let_time_pass(state: AppState, tick_s: float) -> None:
    """Advance the current time by a tick: a recording at its playback speed, a look back towards now.

    Playback of the recording itself is the session's activity.
    """
    if isinstance(state.activity, Playback):
        state.activity.speed = state.play_speed
    elif state.plays_past and state.shown_stamp is not None:
        seek(state, state.shown_stamp + tick_s * state.play_speed - state.live.timeline.start_s)


def seek_event(state: AppState, direction: int) -> None:
    """Show the next moment with an event, or for a negative direction the previous one."""
    seek_mark(state, None, forwards=direction > 0)


def seek_query(state: AppState, direction: int) -> None:
    """Show the next moment at which a query starts, or for a negative direction the previous one."""
    seek_mark(state, MarkKind.QUERY_START, forwards=direction > 0)


def seek_mark(state: AppState, kind: MarkKind | None, *, forwards: bool) -> None:
    """Show the next or the previous moment with a mark of a kind; None means any event."""
    if isinstance(state.activity, Playback):
        state.activity.play(playing=False)
    state.plays_past = False
    run = state.shown_run
    at = run.instant_at(_shown_stamp(state))
    if kind is None:
        found = adjacent_instant(run, at, forwards=forwards)
    else:
        mark = adjacent_mark(run, at, kind, forwards=forwards)
        found = None if mark is None else mark.instant
    if found is not None:
        seek(state, found.stamp - run.start_s + STAMP_EPSILON_S)
    elif forwards and not isinstance(state.activity, Playback):
        show_now(state)
    else:
        thing = "query" if kind is MarkKind.QUERY_START else kind or "event"
        state.say(f"There is no {thing} {'after' if forwards else 'before'} this moment.")


def _shown_stamp(state: AppState) -> float:
    if isinstance(state.activity, Playback):
        return state.activity.stamp
    return state.live.now_s if state.shown_stamp is None else state.shown_stamp
