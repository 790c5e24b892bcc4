"""Goes to another moment of what the page shows: of a recording, or of the live run so far.

Owns the way from event to event. Where the events are is `ltvn_core.analysis.timeline`.
"""

from ltvn_core.analysis.records import Instant, MarkKind
from ltvn_viz.replay import Replay
from ltvn_viz.stage import Stage
from ltvn_viz.why.case import HAIR_S
from ltvn_viz.why.stepping import neighbour, neighbour_mark


def seek(stage: Stage, time_s: float) -> None:
    """Show the world so many seconds after the beginning; live, the end means now."""
    if isinstance(stage.activity, Replay):
        stage.activity.seek(time_s)
        return
    run = stage.live.timeline
    stamp = run.start_s + time_s
    stage.look_back = stamp if stamp < run.end_s else None


def seek_mark(stage: Stage, kind: MarkKind | None, *, forwards: bool) -> None:
    """Show the next moment with a mark of a kind, or with any event for None, or the last one before."""
    if isinstance(stage.activity, Replay):
        stage.activity.play(playing=False)
    run, index = stage.cases.indexed(stage)
    at = _instant(stage)
    if kind is None:
        found = neighbour(index, at, forwards=forwards)
    else:
        mark = neighbour_mark(index, at, kind, forwards=forwards)
        found = None if mark is None else mark.instant
    if found is not None:
        seek(stage, found.stamp - run.start_s + HAIR_S)
    elif forwards and not isinstance(stage.activity, Replay):
        stage.look_back = None
    else:
        thing = "query" if kind is MarkKind.QUERY_START else kind or "event"
        stage.say(f"There is no {thing} {'after' if forwards else 'before'} this moment.")


def _instant(stage: Stage) -> Instant:
    if isinstance(stage.activity, Replay):
        run, stamp = stage.activity.timeline, stage.activity.stamp
    else:
        run = stage.live.timeline
        stamp = run.end_s if stage.look_back is None else stage.look_back
    return Instant(run.step_at(stamp), stamp)
