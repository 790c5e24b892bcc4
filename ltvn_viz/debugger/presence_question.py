"""When an edge was open and when it was blocked, how probably it is open now, and what is expected of it next.

Owns the words and the strip, a small SVG. The numbers are those of `ltvn_core.analysis.edge_presence_history`.
"""

from collections.abc import Sequence
from typing import NamedTuple, Never

from ltvn_core import palette
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
from ltvn_core.graph.presence.observation import PresenceObservation
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.svg_figures import legend_item
from ltvn_viz.session.commands import PointAt
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, stroke

_ROWS = 20
_HOUR_S = 3600.0
_SHORT_HISTORY_S = 6 * _HOUR_S
"""Of what is known for a shorter time no day is foretold in the picture."""

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
_WIDTH_PX, _HEIGHT_PX = 360, 146
_LEFT_PX, _RIGHT_PX, _TOP_PX, _BOTTOM_PX = 34, 8, 20, 38
_TICK_STEPS_S = (60, 300, 600, 1800, 3600, 3 * 3600, 6 * 3600, 12 * 3600, DAY_S, 2 * DAY_S, 7 * DAY_S)
_MOST_TICKS = 4
_INK = "#a6a7ab"


class _Forecast(NamedTuple):
    """What the filter says of one edge."""

    strip: PresenceStrip
    now_s: float
    soon: tuple[float, ...]
    """At the times of `_AHEAD_S` from now."""
    back_s: float | None


class PresenceQuestion(Question[Never]):
    """Shows presence over time."""

    name = QuestionName.PRESENCE
    word = QuestionName.PRESENCE.word
    is_for_watchers = True
    about = "What was seen of an edge when, how probably it is open, what comes next. Click a node, then its neighbour."

    def __init__(self) -> None:
        """Begin with nothing computed."""
        self._latest = LatestAnswer()
        self._asked: object = None

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether any edge was ever seen blocked in the run."""
        return context.was_seen_blocked

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the edge that was pointed at, or all edges that were ever seen blocked."""
        builder = AnswerBuilder()
        known = context.graph.presence
        if not known:
            builder.add_text("No edge was seen blocked up to now.")
            return builder.build()
        edge = selection.edge
        if edge is None or edge not in known:
            return _all_edges(context, edge, builder)
        builder.add_html(
            f"<div>Edge <b>{edge[0]} → {edge[1]}</b> · {builder.link('all edges', PointAt(edge[0]))}</div>"
        )
        return self._edge(context, edge, builder)

    def _edge(self, context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> QuestionAnswer:
        seen, now_s = context.graph.presence[edge], context.world_s
        asked = context.name, context.start_s, edge, context.known_filter
        if asked != self._asked:
            self._asked = asked
            self._latest.forget()
        question = "presence", *asked, seen, round(now_s)
        forecast = self._latest(
            context.in_background, question, lambda: _forecast(seen, context.known_filter, round(now_s, 1))
        )
        if forecast is None:
            builder.add_pending("Following it through time")
        else:
            builder.add_behind(self._latest)
            _show_forecast(seen, forecast, builder)
        _looks(context, edge, builder)
        _note(context, builder)
        return builder.build(_overlay(context, edge))


def _forecast(seen: Sequence[PresenceObservation], presence_filter: PresenceFilter, now_s: float) -> _Forecast:
    history_s = now_s - seen[0].stamp_s
    ahead_s = DAY_S if history_s > _SHORT_HISTORY_S else _HOUR_S
    strip = presence_strip(seen, presence_filter, strip_times(seen, now_s, ahead_s=ahead_s))
    soon = presence_strip(seen, presence_filter, [now_s + ahead for _, ahead in _AHEAD_S]).probabilities
    return _Forecast(strip, now_s, soon, expected_open_s(seen, presence_filter, now_s))


def _show_forecast(seen: Sequence[PresenceObservation], forecast: _Forecast, builder: AnswerBuilder) -> None:
    builder.add_html(presence_strip_svg(forecast.strip, seen, forecast.now_s))
    builder.add_html(
        f"<div>{legend_item(palette.EDGE_ADDED, 'seen open')}{legend_item(palette.EDGE_REMOVED, 'seen blocked')}"
        f"{legend_item(palette.SOURCE, 'p open, dashed: foretold')}</div>"
    )
    rows = [(when, f"{p:.2f}", _state(p)) for (when, _), p in zip(_AHEAD_S, forecast.soon, strict=True)]
    builder.add_table((f"it is {clock_text(forecast.now_s)}", "p open", "taken for"), rows)
    if forecast.back_s is not None:
        builder.add_text(
            f"If nobody looks it is taken for open again from {clock_text(forecast.back_s)} on, in "
            f"{duration_text(forecast.back_s - forecast.now_s)}."
        )
    elif forecast.soon[0] < 0.5:
        builder.add_text("If nobody looks it is not taken for open again within two weeks.")


def _state(p: float) -> str:
    state = presence_state(p)
    return f'<span style="color:{STATE_COLOURS[state].css}">{state}</span>'


def _looks(context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> None:
    """Show the observations of this run, newest first, each with the way to its moment."""
    looks = observed_presence(context.timeline, *edge, context.instant)
    rows = [_look(context, each, builder) for each in reversed(looks[-_ROWS:])]
    builder.add_table(("when", "seen", "learned", "moment"), rows)


def _look(context: DebugContext, look: ObservedPresence, builder: AnswerBuilder) -> tuple[str, ...]:
    how = "with the map" if look.cause == "load" else "on an attempt" if look.attempt is not None else "from afar"
    seen = "open" if look.observation.present else "blocked"
    return clock_text(look.observation.stamp_s), seen, how, builder.time_link(context.seconds(look.instant))


def _all_edges(context: DebugContext, asked: EdgeKey | None, builder: AnswerBuilder) -> QuestionAnswer:
    """Offer all edges that were ever seen blocked, the least probably open first."""
    if asked is not None:
        builder.add_text(f"Edge {asked[0]} → {asked[1]} was never seen blocked, so it is held to be open.")
    found = presence_as_if(context.graph, context.known_filter, context.world_s)
    ordered = sorted(found, key=found.__getitem__)
    builder.add_text(f"{len(ordered)} edges were seen blocked at some time. It is {clock_text(context.world_s)}.")
    rows = []
    for edge in ordered[:_ROWS]:
        last = context.graph.presence[edge][-1]
        ago = duration_text(max(0.0, context.world_s - last.stamp_s))
        name = builder.link(f"{edge[0]} → {edge[1]}", PointAt(*edge))
        seen = f"{'open' if last.present else 'blocked'}, {ago} ago"
        rows.append((name, f"{found[edge]:.2f}", _state(found[edge]), seen))
    builder.add_table(("edge", "p open", "taken for", "seen last"), rows)
    if len(ordered) > _ROWS:
        builder.add_text(f"… and {len(ordered) - _ROWS} more that are more probably open.")
    _note(context, builder)
    colours = {edge: STATE_COLOURS[presence_state(p)] for edge, p in found.items()}
    ends = [(context.pose(edge[0]), context.pose(edge[1]), colour) for edge, colour in colours.items()]
    strokes = tuple(stroke(start, end, colour) for start, end, colour in ends if start is not None and end is not None)
    return builder.build(Overlay(strokes=strokes))


def _note(context: DebugContext, builder: AnswerBuilder) -> None:
    if context.presence_filter is None:
        builder.add_text("Plans of this run take no account of it; probabilities are those of the filter “persistent”.")


def _overlay(context: DebugContext, edge: EdgeKey) -> Overlay:
    start, end = context.pose(edge[0]), context.pose(edge[1])
    if start is None or end is None:
        return EMPTY_OVERLAY
    return Overlay((stroke(start, end, palette.TARGET),), {edge[0]: palette.SOURCE, edge[1]: palette.TARGET})


class _Frame(NamedTuple):
    """Where times and probabilities are drawn."""

    first_s: float
    last_s: float

    def x(self, at_s: float) -> float:
        """Return the column of a time."""
        share = (at_s - self.first_s) / (self.last_s - self.first_s)
        return _LEFT_PX + share * (_WIDTH_PX - _LEFT_PX - _RIGHT_PX)

    def y(self, p: float) -> float:
        """Return the row of a probability."""
        return _TOP_PX + (1 - p) * (_HEIGHT_PX - _TOP_PX - _BOTTOM_PX)


def presence_strip_svg(strip: PresenceStrip, observations: Sequence[PresenceObservation], now_s: float) -> str:
    """Return the strip as an SVG: probability over the clock of the world, what is foretold after `now_s` dashed."""
    frame = _Frame(strip.times_s[0], max(strip.times_s[-1], strip.times_s[0] + 1.0))
    points = list(zip(strip.times_s, strip.probabilities, strict=True))
    past = [point for point in points if point[0] <= now_s]
    ahead = past[-1:] + [point for point in points if point[0] > now_s]
    label = "probability that the edge is open, over time"
    return (
        f'<svg viewBox="0 0 {_WIDTH_PX} {_HEIGHT_PX}" role="img" aria-label="{label}" class="lt-curve">'
        f"{_axes(frame)}{_now(frame, now_s)}{_line(frame, past)}{_line(frame, ahead, dashed=True)}"
        f"{_marks(frame, observations)}</svg>"
    )


def strip_times(observations: Sequence[PresenceObservation], now_s: float, *, ahead_s: float) -> tuple[float, ...]:
    """Return the times at which a strip is drawn: evenly from the first observation on, and around each of them."""
    first = min([now_s - 600.0, *(seen.stamp_s for seen in observations)])
    first = max(first - 0.02 * (now_s - first), now_s - 8 * DAY_S)
    count = 120
    even = [first + (now_s + ahead_s - first) * number / count for number in range(count + 1)]
    looks = [at_s for seen in observations for at_s in (seen.stamp_s - 1e-3, seen.stamp_s)]
    return tuple(sorted({*even, now_s, *(at_s for at_s in looks if at_s >= first)}))


def _line(frame: _Frame, points: Sequence[tuple[float, float]], *, dashed: bool = False) -> str:
    if len(points) < 2:
        return ""
    way = "L".join(f"{frame.x(at_s):.1f} {frame.y(p):.1f}" for at_s, p in points)
    style = ' stroke-dasharray="4 3"' if dashed else ""
    return f'<path d="M{way}" fill="none" stroke="{palette.SOURCE.css}" stroke-width="2"{style}/>'


def _marks(frame: _Frame, observations: Sequence[PresenceObservation]) -> str:
    """Return a mark for each observation: above the line at 1 where it was open, below that at 0 where blocked."""
    marks = ""
    for seen in observations:
        if frame.first_s <= seen.stamp_s <= frame.last_s:
            colour = palette.EDGE_ADDED if seen.present else palette.EDGE_REMOVED
            row = frame.y(1.0) if seen.present else frame.y(0.0)
            words = f"seen {'open' if seen.present else 'blocked'}, {clock_text(seen.stamp_s)}"
            marks += (
                f'<circle cx="{frame.x(seen.stamp_s):.1f}" cy="{row:.1f}" r="3.5" fill="{colour.css}">'
                f"<title>{words}</title></circle>"
            )
    return marks


def _now(frame: _Frame, now_s: float) -> str:
    x = frame.x(now_s)
    anchor = "end" if x > 0.8 * _WIDTH_PX else "start"
    return (
        f'<path d="M{x:.1f} {_TOP_PX - 4}V{frame.y(0.0):.1f}" stroke="white" stroke-width="1.5"/>'
        f'<text x="{x + (-3 if anchor == "end" else 3):.1f}" y="{_TOP_PX - 3}" font-size="13" text-anchor="{anchor}" '
        f'fill="white">now</text>'
    )


def _axes(frame: _Frame) -> str:
    bottom, right = frame.y(0.0), _WIDTH_PX - _RIGHT_PX
    rules = "".join(
        f'<text x="{_LEFT_PX - 4}" y="{frame.y(p) + 3:.1f}" font-size="13" text-anchor="end" fill="{_INK}">{p:g}</text>'
        for p in (0.0, OPEN_ABOVE, 1.0)
    )
    threshold = frame.y(OPEN_ABOVE)
    ticks = "".join(_tick(frame, at_s, bottom) for at_s in _ticks(frame))
    is_clock = clock_text(frame.first_s).startswith("day")
    unit = f"{clock_text(frame.first_s).split(',')[0]} …, hours" if is_clock else "seconds"
    return (
        f'<path d="M{_LEFT_PX} {_TOP_PX}V{bottom:.1f}H{right}" fill="none" stroke="#868e96"/>'
        f'<path d="M{_LEFT_PX} {threshold:.1f}H{right}" stroke="#868e96" stroke-dasharray="4 3"/>{rules}{ticks}'
        f'<text x="{_LEFT_PX + 4}" y="{_TOP_PX - 3}" font-size="13" fill="{_INK}">p open</text>'
        f'<text x="{right}" y="{_HEIGHT_PX - 3}" font-size="13" text-anchor="end" fill="{_INK}">{unit}</text>'
    )


def _ticks(frame: _Frame) -> list[float]:
    span = frame.last_s - frame.first_s
    step = next((step for step in _TICK_STEPS_S if span / step <= _MOST_TICKS), span / _MOST_TICKS)
    first = int(frame.first_s // step) + 1
    return [number * step for number in range(first, int(frame.last_s // step) + 1)]


def _tick(frame: _Frame, at_s: float, bottom: float) -> str:
    words = clock_text(at_s)
    words = words.split(", ")[-1] if at_s % DAY_S or frame.last_s - frame.first_s < DAY_S else words.split(",")[0]
    return (
        f'<path d="M{frame.x(at_s):.1f} {bottom:.1f}v4" stroke="#868e96"/>'
        f'<text x="{frame.x(at_s):.1f}" y="{bottom + 17:.1f}" font-size="13" text-anchor="middle" '
        f'fill="{_INK}">{words}</text>'
    )
