"""Presence of an edge: when it was open and blocked, p(open) now and later, and the plans that p(open) decided.

Owns the texts. The numbers come from `ltvn_core.analysis.presence_forecast`.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.analysis.answer import Coloured, Inline, Key, Link, PresenceChart, Strong
from ltvn_core.analysis.edge_story import EdgeStory
from ltvn_core.analysis.plan_explanation import PresenceDecision, explain_decision, presence_decision
from ltvn_core.analysis.presence_forecast import (
    PresenceState,
    expected_open_s,
    presence_as_if,
    presence_over_time,
    presence_state,
)
from ltvn_core.analysis.world_clock import DAY_S, clock_text, duration_text
from ltvn_core.graph.presence.presence_filter import PresenceFilter, PresenceObservation
from ltvn_core.navigation.events import OBSTRUCTED_ENDS
from ltvn_core.palette import Rgb8
from ltvn_core.terminal_text import count_text
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, edge_link, time_link
from ltvn_viz.session.inspection import Stroke
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
    now_s: float
    points: tuple[tuple[float, float], ...]
    """(time, p(open))."""
    soon: tuple[float, ...]
    """p(open) at the times of `_AHEAD_S` from now."""
    back_s: float | None
    """When it counts as open again."""


class EdgePresencePart:
    """Shows presence over time; caches the last result."""

    def __init__(self) -> None:
        """Start with an empty cache."""
        self._latest = LatestAnswer()

    def add_edge(self, context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
        """Show when an edge was open, is open and will be open; nothing if no edge was ever seen blocked or
        obstructed."""
        edge = story.edge
        if edge not in context.graph.presence:
            _add_unseen(context, story, builder)
            return
        seen = context.graph.presence[edge]
        now_s = context.world_s
        asked = context.name, context.start_s, edge, context.known_filter
        self._latest.about(asked)
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
        _looks(context, story, builder)
        _note(context, builder)


def _add_unseen(context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
    blocked = sum(each.ended is not None and each.ended.end in OBSTRUCTED_ENDS for each in story.attempts)
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
    times = _chart_times(seen, now_s, now_s + ahead_s)
    points = tuple(zip(times, presence_over_time(seen, presence_filter, times), strict=True))
    soon = presence_over_time(seen, presence_filter, [now_s + ahead for _, ahead in _AHEAD_S])
    return _Forecast(now_s, points, soon, expected_open_s(seen, presence_filter, now_s))


def _show_forecast(seen: Sequence[PresenceObservation], forecast: _Forecast, builder: AnswerBuilder) -> None:
    now_s, points, soon, back_s = forecast
    builder.add_chart(PresenceChart(points, tuple(seen), now_s))
    builder.add_line(
        Key(palette.EDGE_ADDED, "seen open"),
        Key(palette.EDGE_REMOVED, "seen blocked"),
        Key(palette.SOURCE, "p open, dashed: foretold"),
    )
    rows = [(when, f"{p:.2f}", _state(p)) for (when, _), p in zip(_AHEAD_S, soon, strict=True)]
    builder.add_table((f"it is {clock_text(now_s)}", "p open", "taken for"), rows)
    if back_s is not None:
        builder.add_line(
            f"Without new observations it counts as open again from {clock_text(back_s)} on, in "
            f"{duration_text(back_s - now_s)}."
        )
    elif soon[0] < 0.5:
        builder.add_line("Without new observations it does not count as open again within two weeks.")


def _state(p: float) -> Coloured:
    state = presence_state(p)
    return Coloured(state, STATE_COLOURS[state])


def _looks(context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
    """Show the observations of this run, newest first, each with a link to its moment."""
    rows = []
    for row in reversed(story.looks[-_ROWS:]):
        if row.seen is not None:
            how = "with the map" if row.cause == "load" else "on an attempt" if row.attempt is not None else "from afar"
            when, seen = clock_text(row.seen.stamp_s), "open" if row.seen.present else "blocked"
            rows.append((when, seen, how, time_link(context.seconds(row.instant))))
    builder.add_table(("when", "seen", "learned", "moment"), rows)


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
    rows: list[tuple[Inline, ...]] = []
    for edge in ordered[:_ROWS]:
        last = context.graph.presence[edge][-1]
        ago = duration_text(max(0.0, context.world_s - last.stamp_s))
        seen = f"{'open' if last.present else 'blocked'}, {ago} ago"
        rows.append((edge_link(*edge), f"{found[edge]:.2f}", _state(found[edge]), seen))
    builder.add_table(("edge", "p open", "taken for", "seen last"), rows, len(ordered))
    _note(context, builder)
    colours = {edge: STATE_COLOURS[presence_state(p)] for edge, p in found.items()}
    return tuple(line for edge, colour in colours.items() for line in context.strokes([edge], colour))


def _note(context: DebugContext, builder: AnswerBuilder) -> None:
    if context.presence_filter is None:
        builder.add_line(
            "Plans of this run ignore which edges are open now. Probabilities are those of the filter “persistent”."
        )


def _chart_times(observations: Sequence[PresenceObservation], now_s: float, last_s: float) -> tuple[float, ...]:
    """Return the times at which p(open) is drawn: evenly spaced from the first observation, and around each one."""
    first = min([now_s - 600.0, *(seen.stamp_s for seen in observations)])
    first = max(first - 0.02 * (now_s - first), now_s - 8 * DAY_S)
    count = 120
    even = [first + (last_s - first) * number / count for number in range(count + 1)]
    looks = [at_s for seen in observations for at_s in (seen.stamp_s - 1e-3, seen.stamp_s)]
    return tuple(sorted({*even, now_s, *(at_s for at_s in looks if at_s >= first)}))


_EARLIER = 8
_PLANS = 40
"""Number of the latest plans up to the moment that are searched."""
_TRIED = "Why did the robot try it, or go around?"


class EdgeDecisionsPart:
    """Explains plans by p(open); caches the last result."""

    def __init__(self) -> None:
        """Start with an empty cache."""
        self._latest = LatestAnswer()

    def add(self, context: DebugContext, story: EdgeStory | None, builder: AnswerBuilder) -> tuple[Stroke, ...]:
        """Explain the last plan in which an edge was driven or avoided although it was last seen blocked; return the
        strokes.

        Without the story of an edge, explain the last such plan of any edge. Earlier such plans are listed with links.
        Adds nothing if the edge was never observed, or plans ignore presence.
        """
        edge, seen = (None, context.graph.presence) if story is None else (story.edge, story.looks)
        if context.presence_filter is None or not seen:
            return ()
        found = self._decisions(context)
        if found is None:
            builder.add_pending("Planning once more", title=_TRIED)
            return ()
        chosen = [each for each in found if edge in (None, each.edge)]
        if not chosen:
            builder.add_behind(self._latest)
            which = "an edge" if edge is None else "it"
            builder.add_line(
                Strong(_TRIED), f" Up to now, no shortest path led through {which} that was last seen blocked."
            )
            return ()
        made = chosen[-1]
        _explain(context, made, self._latest, builder)
        _others(context, [each for each in found if each is not made], builder)
        return (
            *context.strokes(itertools.pairwise(made.around.nodes), palette.PLAN),
            *context.strokes(itertools.pairwise(made.through.nodes), palette.TARGET),
            *context.strokes([made.edge], palette.EDGE_REMOVED),
        )

    def _decisions(self, context: DebugContext) -> Sequence[PresenceDecision] | None:
        count = context.timeline.count_until(context.instant)
        plans = [plan for plan in context.timeline.plans if plan.event < count][-_PLANS:]
        last = plans[-1].event if plans else -1
        run = context.name, context.start_s
        self._latest.about(run)
        timeline, rules = context.timeline.copy(), context.rules

        def explain() -> list[PresenceDecision]:
            made = (presence_decision(timeline, plan, rules) for plan in plans)
            return [each for each in made if each is not None]

        return self._latest(context.in_background, ("tried", *run, last), explain)


def _explain(context: DebugContext, made: PresenceDecision, latest: LatestAnswer, builder: AnswerBuilder) -> None:
    title = "Why did the robot try it?" if made.tried else "Why did the robot go around?"
    when = time_link(context.seconds(made.plan.instant))
    query = made.plan.planned.query
    builder.add_line(Strong(title), f" Query {query}, ", when, ", edge ", edge_link(*made.edge), ".")
    builder.add_behind(latest)
    for sentence in explain_decision(made):
        builder.add_line(sentence.replace("->", "→").replace(" x ", " × "))
    builder.add_line(
        Key(palette.TARGET, "through"), Key(palette.PLAN, "around"), Key(palette.EDGE_REMOVED, "seen blocked")
    )


def _others(context: DebugContext, others: Sequence[PresenceDecision], builder: AnswerBuilder) -> None:
    rows = [
        (
            time_link(context.seconds(each.plan.instant)),
            edge_link(*each.edge),
            f"{each.p:.2f}",
            "tried" if each.tried else "around",
        )
        for each in reversed(others[-_EARLIER:])
    ]
    builder.add_table(("before", "edge", "p open", "it"), rows)
