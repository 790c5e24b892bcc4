"""Presence of an edge: its history of open and blocked times, its present p(open), and a forecast.

Owns the texts. The numbers come from `ltvn_core.analysis.edge_presence_history`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.analysis.answer import Coloured, Inline, Key, Link, LookMark, PresenceChart, Strong
from ltvn_core.analysis.edge_history import EdgeHistory
from ltvn_core.analysis.edge_presence_history import (
    ObservedPresence,
    PresenceState,
    PresenceStrip,
    expected_open_s,
    observed_presence,
    presence_as_if,
    presence_state,
    presence_strip,
)
from ltvn_core.analysis.world_clock import DAY_S, clock_text, duration_text
from ltvn_core.graph.presence.presence_filter import PresenceFilter, PresenceObservation
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import OBSTRUCTED_ENDS
from ltvn_core.palette import Rgb8
from ltvn_core.terminal_text import count_text
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, edge_link, time_link
from ltvn_viz.session.inspection import Stroke, stroke
from ltvn_viz.wishes.commands import PointAt

_TITLE = "When is it open?"
_ROWS = 20
_HOUR_S = 3600.0
_SHORT_HISTORY_S = 6 * _HOUR_S
"""Least length of the history in seconds for which the chart has a forecast of a day."""

STATE_COLOURS: dict[PresenceState, Rgb8] = {
    PresenceState.OPEN: palette.EDGE_ADDED,
    PresenceState.UNKNOWN: palette.PLAN,
    PresenceState.CLOSED: palette.EDGE_REMOVED,
}
_AHEAD_S: tuple[tuple[str, float], ...] = (
    ("now", 0.0),
    ("in 10 min", 600.0),
    ("in an hour", _HOUR_S),
    ("tomorrow at this time", DAY_S),
)


class _Forecast(NamedTuple):
    """The filter's predictions for one edge."""

    strip: PresenceStrip
    now_s: float
    soon: tuple[float, ...]
    """p(open) at the times of `_AHEAD_S` from now."""
    back_s: float | None


class EdgePresencePart:
    """Shows presence over time; caches the last result."""

    def __init__(self) -> None:
        """Start with an empty cache."""
        self._latest = LatestAnswer()
        self._asked: object = None

    def add_edge(self, context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
        """Show when an edge was open, is open and will be open; nothing if no edge was ever seen blocked or
        obstructed."""
        edge = story.source, story.target
        if edge not in context.graph.presence:
            _add_unseen(context, story, builder)
            return
        seen = context.graph.presence[edge]
        now_s = context.world_s
        asked = context.name, context.start_s, edge, context.known_filter
        if asked != self._asked:
            self._asked = asked
            self._latest.forget()
        question = "presence", *asked, seen, round(now_s)
        forecast = self._latest(
            context.in_background, question, lambda: _forecast(seen, context.known_filter, round(now_s, 1))
        )
        if forecast is None:
            builder.add_pending("Computing it over time", title=_TITLE)
        else:
            builder.add_line(Strong(_TITLE), " ", Link("all edges that were seen blocked", PointAt(edge[0])))
            builder.add_behind(self._latest)
            _show_forecast(seen, forecast, builder)
        _looks(context, edge, builder)
        _note(context, builder)


def _add_unseen(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    blocked = sum(each.end in OBSTRUCTED_ENDS for each in story.attempts)
    if blocked:
        met = f"An obstacle blocked it in {count_text(blocked, 'attempt')}"
        if context.presence_filter is None:
            builder.add_line(Strong(_TITLE), f" Plans of this run ignore whether it is open. {met}.")
        else:
            builder.add_line(Strong(_TITLE), f" {met}, but the map has not recorded it as blocked for a time.")
    elif context.graph.presence:
        builder.add_line(Strong(_TITLE), " It was never seen blocked, so it counts as open.")


def _forecast(seen: Sequence[PresenceObservation], presence_filter: PresenceFilter, now_s: float) -> _Forecast:
    history_s = now_s - seen[0].stamp_s
    ahead_s = DAY_S if history_s > _SHORT_HISTORY_S else _HOUR_S
    strip = presence_strip(seen, presence_filter, strip_times(seen, now_s, ahead_s=ahead_s))
    soon = presence_strip(seen, presence_filter, [now_s + ahead for _, ahead in _AHEAD_S]).probabilities
    return _Forecast(strip, now_s, soon, expected_open_s(seen, presence_filter, now_s))


def _show_forecast(seen: Sequence[PresenceObservation], forecast: _Forecast, builder: AnswerBuilder) -> None:
    points = tuple(zip(forecast.strip.times_s, forecast.strip.probabilities, strict=True))
    looks = tuple(LookMark(each.stamp_s, each.present) for each in seen)
    builder.add_chart(PresenceChart(points, looks, forecast.now_s))
    builder.add_line(
        Key(palette.EDGE_ADDED, "seen open"),
        Key(palette.EDGE_REMOVED, "seen blocked"),
        Key(palette.SOURCE, "p open, dashed: foretold"),
    )
    rows = [(when, f"{p:.2f}", _state(p)) for (when, _), p in zip(_AHEAD_S, forecast.soon, strict=True)]
    builder.add_table((f"it is {clock_text(forecast.now_s)}", "p open", "taken for"), rows)
    if forecast.back_s is not None:
        builder.add_line(
            f"Without new observations it counts as open again from {clock_text(forecast.back_s)} on, in "
            f"{duration_text(forecast.back_s - forecast.now_s)}."
        )
    elif forecast.soon[0] < 0.5:
        builder.add_line("Without new observations it does not count as open again within two weeks.")


def _state(p: float) -> Coloured:
    state = presence_state(p)
    return Coloured(state, STATE_COLOURS[state])


def _looks(context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> None:
    """Show the observations of this run, newest first, each with a link to its moment."""
    looks = observed_presence(context.timeline, *edge, context.instant)
    rows = [_look(context, each) for each in reversed(looks[-_ROWS:])]
    builder.add_table(("when", "seen", "learned", "moment"), rows)


def _look(context: DebugContext, look: ObservedPresence) -> tuple[Inline, ...]:
    how = "with the map" if look.cause == "load" else "on an attempt" if look.attempt is not None else "from afar"
    seen = "open" if look.observation.present else "blocked"
    return clock_text(look.observation.stamp_s), seen, how, time_link(context.seconds(look.instant))


def add_all_edges(context: DebugContext, builder: AnswerBuilder) -> tuple[Stroke, ...]:
    """Offer all edges that were ever seen blocked, the lowest p(open) first, and return their strokes."""
    if not context.graph.presence:
        return ()
    found = presence_as_if(context.graph, context.known_filter, context.world_s)
    ordered = sorted(found, key=found.__getitem__)
    count = count_text(len(ordered), "edge was", "edges were")
    builder.add_line(
        Strong("What is open?"), f" {count} seen blocked at some time. It is {clock_text(context.world_s)}."
    )
    rows = [_edge_row(context, edge, found[edge]) for edge in ordered[:_ROWS]]
    builder.add_table(("edge", "p open", "taken for", "seen last"), rows)
    if len(ordered) > _ROWS:
        builder.add_line(f"… and {len(ordered) - _ROWS} more with a higher probability.")
    _note(context, builder)
    colours = {edge: STATE_COLOURS[presence_state(p)] for edge, p in found.items()}
    ends = [(context.pose(edge[0]), context.pose(edge[1]), colour) for edge, colour in colours.items()]
    return tuple(stroke(start, end, colour) for start, end, colour in ends if start is not None and end is not None)


def _edge_row(context: DebugContext, edge: EdgeKey, p: float) -> tuple[Inline, ...]:
    last = context.graph.presence[edge][-1]
    ago = duration_text(max(0.0, context.world_s - last.stamp_s))
    return edge_link(*edge), f"{p:.2f}", _state(p), f"{'open' if last.present else 'blocked'}, {ago} ago"


def _note(context: DebugContext, builder: AnswerBuilder) -> None:
    if context.presence_filter is None:
        builder.add_line(
            "Plans of this run ignore which edges are open now. Probabilities are those of the filter “persistent”."
        )


def strip_times(observations: Sequence[PresenceObservation], now_s: float, *, ahead_s: float) -> tuple[float, ...]:
    """Return the times at which p(open) is drawn: evenly spaced from the first observation, and around each one."""
    first = min([now_s - 600.0, *(seen.stamp_s for seen in observations)])
    first = max(first - 0.02 * (now_s - first), now_s - 8 * DAY_S)
    count = 120
    even = [first + (now_s + ahead_s - first) * number / count for number in range(count + 1)]
    looks = [at_s for seen in observations for at_s in (seen.stamp_s - 1e-3, seen.stamp_s)]
    return tuple(sorted({*even, now_s, *(at_s for at_s in looks if at_s >= first)}))
