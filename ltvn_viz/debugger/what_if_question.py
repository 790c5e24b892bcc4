"""What if: the old and the new plan side by side."""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TypeAlias, assert_never

from ltvn_core import palette
from ltvn_core.analysis.answer import Inline, Link, Step, Strong, joined
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.presence_forecast import presence_changes
from ltvn_core.analysis.replanning import EdgeCostParts, Moment, PlanDifference, Rules, imagine, moment_at, replan
from ltvn_core.analysis.what_if_changes import (
    WhatIfChange,
    WithBelief,
    WithEdge,
    WithGoal,
    WithoutEdge,
    WithStart,
    WithThreshold,
    WithTime,
    format_what_if_change,
    parse_what_if_change,
)
from ltvn_core.analysis.world_clock import DAY_S, TimeAway, TimeOfDay, clock_text
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph.presence.edge_presence import OPEN_ABOVE
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, edge_link, has_map, request_link, time_link
from ltvn_viz.session.inspection import EMPTY_OVERLAY, Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.wishes.commands import QuestionRequest

_ROWS = 12
OFFERED_TIMES = (WithTime(TimeOfDay(18 * 3600.0)), WithTime(TimeAway(3600.0)), WithTime(TimeAway(DAY_S)))
"""Times that are offered as links; others may be typed."""
_BEFORE_REMOVAL_S = 1.0
_FORGET = "forget "
_ALL = "all"


@dataclass(frozen=True, slots=True)
class ImagineChange(QuestionRequest):
    """Add a change to the scenario, in place of an earlier one of the same subject."""

    change: WhatIfChange


@dataclass(frozen=True, slots=True)
class ForgetChange(QuestionRequest):
    """Remove a change from the scenario."""

    change: WhatIfChange | None
    """None for all changes."""


WhatIfRequest: TypeAlias = ImagineChange | ForgetChange


def _plan_both_ways(moment: Moment, changes: tuple[WhatIfChange, ...], rules: Rules) -> PlanDifference | str:
    """Plan without and with the changes, or say why not; copies the map and runs two searches, eight if edges may be
    closed."""
    place = [each for each in changes if isinstance(each, WithGoal | WithStart)]
    try:
        # Both plans start at an imagined place, so that they differ only by other changes.
        here = moment if len(place) == len(changes) else imagine(moment, place, rules)[0]
        return PlanDifference(replan(here, (), rules), replan(here, changes, rules))
    except LtvnError as error:
        return str(error)


class WhatIfQuestion(Question[WhatIfRequest]):
    """Shows the effects of imagined changes, without making them."""

    name = QuestionName.WHAT_IF
    is_offered = has_map
    verb = "Imagine"
    about = "Plan again with another edge, belief, goal, threshold or time. Map and run do not change."

    def __init__(self) -> None:
        """Start without changes."""
        self._changes: dict[Hashable, WhatIfChange] = {}
        self._told = 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the scenario and its effects."""
        builder = AnswerBuilder()
        self._offers(context, selection, builder)
        if context.graph.presence:
            if context.presence_filter is None:
                builder.add_line("Plans of this run ignore when edges are open.")
            else:
                times = joined(map(_offer, OFFERED_TIMES))
                builder.add_line(f"It is {clock_text(context.world_s)}. What if it were ", times)
        for each in self._changes.values():
            builder.add_line(Strong(format_what_if_change(each)), " · ", request_link("forget", ForgetChange(each)))
        if len(self._changes) > 1:
            builder.add_line(request_link("forget all", ForgetChange(None)))
        overlay = EMPTY_OVERLAY
        if self._changes:
            overlay = self._compared(context, builder)
        return builder.build(overlay, input_hint="What if (D_c = 1.3, goal 120, at 18:00 …)")

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Add a typed change, or "forget" one or "all" of them. Raises OptionError, MapError."""
        words = " ".join(text.split())
        named = words.removeprefix(_FORGET)
        if named == words:
            self.handle_request(context, ImagineChange(parse_what_if_change(words)))
        else:
            self.handle_request(context, ForgetChange(None if named == _ALL else parse_what_if_change(named)))

    def handle_request(self, context: DebugContext, request: WhatIfRequest) -> None:
        """Add or remove a change. Raises OptionError if the change to remove is not in the scenario."""
        match request:
            case ImagineChange(change):
                self._changes.pop(_about(change), None)
                self._changes[_about(change)] = change
            case ForgetChange(change):
                if change is None:
                    self._changes = {}
                elif self._changes.get(_about(change)) != change:
                    imagined = ", ".join(map(format_what_if_change, self._all)) or "nothing"
                    raise OptionError(
                        f"{format_what_if_change(change)!r} is not one of the changes; the changes are {imagined}."
                    )
                else:
                    del self._changes[_about(change)]
            case _:
                assert_never(request)
        self._told += 1

    @staticmethod
    def _offers(context: DebugContext, selection: Selection, builder: AnswerBuilder) -> None:
        offers: list[WhatIfChange] = []
        if (edge := selection.edge or selection.pair) is not None:
            known = (WithoutEdge(*edge), WithBelief(*edge, p=0.1), WithBelief(*edge, p=0.9))
            offers += known if edge in context.graph.edges else (WithEdge(*edge),)
        if selection.node is not None:
            offers += WithGoal(selection.node), WithStart(selection.node)
        if offers:
            builder.add_line("What if: ", joined(map(_offer, offers)))
        else:
            source, target = next(iter(context.graph.edges), (12, 40))
            builder.add_line(
                Step(
                    "Click a node, then its neighbour, to change the edge between them, or type below.",
                    f'Write a change, for instance --text "without {source}->{target}", or point at --edge FROM TO.',
                )
            )

    def _compared(self, context: DebugContext, builder: AnswerBuilder) -> Overlay:
        moment = moment_at(context.timeline, context.instant, context.graph)
        changes = self._all
        known = (
            context.timeline.change_count_before(context.timeline.count_until(context.instant)),
            moment.source,
            moment.goal,
            # The time is rounded to seconds, because p(open) hardly changes within a second.
            round(moment.at_s) if context.graph.presence else 0,
        )
        question = "what if", context.name, self._told, *known, *moment.failures.items()
        plan = partial(_plan_both_ways, moment, changes, context.rules)
        plans: PlanDifference | str | None = context.in_background(question, plan)
        if plans is None:
            builder.add_pending("Planning both ways")
            return EMPTY_OVERLAY
        if isinstance(plans, str):
            builder.add_line(plans)
            _say_when_it_was(context, changes, builder)
            return EMPTY_OVERLAY
        if context.rules_note:
            builder.add_line(context.rules_note)
        _say(plans, changes, builder)
        return Overlay(
            (
                *context.strokes(pairwise(plans.old.path.nodes), palette.PLAN),
                *context.strokes(plans.added_edges, palette.EDGE_ADDED),
            )
        )

    @property
    def _all(self) -> tuple[WhatIfChange, ...]:
        return tuple(self._changes.values())


def _about(change: WhatIfChange) -> Hashable:
    """Return the subject of a change; a later change of the same subject replaces it."""
    match change:
        case WithEdge(source, target) | WithoutEdge(source, target):
            return "there", source, target
        case WithBelief(source, target, p):
            return "mu" if p is None else "p", source, target
        case WithThreshold(threshold):
            return threshold
        case WithGoal() | WithStart() | WithTime():
            return type(change)
    assert_never(change)


def _say_when_it_was(context: DebugContext, changes: Sequence[WhatIfChange], builder: AnswerBuilder) -> None:
    """Name a moment for each edge of the changes that the map has at other moments only."""
    for edge in [(each.source, each.target) for each in changes if isinstance(each, WithoutEdge | WithBelief)]:
        story = edge_story(context.timeline, *edge)
        if story.life and edge not in context.graph.edges:
            begin_s = context.seconds(story.life[0].instant)
            end = story.end
            moment_s = begin_s if end is None else max(begin_s, context.seconds(end.instant) - _BEFORE_REMOVAL_S)
            when = f"{math.ceil(moment_s * 1000) / 1000:g}"
            builder.add_line(
                f"Edge {edge[0]} → {edge[1]} is in the map at ",
                time_link(moment_s),
                Step(".", f": ask with --at {when}."),
            )


def _offer(change: WhatIfChange) -> Link:
    return request_link(format_what_if_change(change), ImagineChange(change))


def _say(plans: PlanDifference, changes: Sequence[WhatIfChange], builder: AnswerBuilder) -> None:
    old, new = plans.old, plans.new
    for note in new.notes:
        builder.add_line(note)
    if old.open_edges != new.open_edges:
        _add_open_edges(plans, builder)
    # A robot that a change makes lost is still asked about from its place.
    source = next((each.source for each in reversed(changes) if isinstance(each, WithStart)), old.moment.source)
    goal = new.moment.goal
    if source is None or goal is None:
        return
    builder.add_line(f"From {source} to {goal}: ", Strong(plans.sentence))
    removed, added = set(plans.removed_edges), set(plans.added_edges)
    rows = [_row("old", each) for each in old.edges if each.edge in removed]
    rows += [_row("new", each) for each in new.edges if each.edge in added]
    if not rows:
        known = {each.edge: each for each in old.edges}
        rows = [_row("now", each) for each in new.edges if known.get(each.edge) != each]
    builder.add_table(("plan", "edge", "length (mu)", "doubt", "failed", "p open"), rows[:_ROWS])


def _row(plan: str, priced: EdgeCostParts) -> tuple[Inline, ...]:
    numbers = (f"{each:.2f}" for each in (priced.mu, priced.doubt, priced.penalty, priced.open_p))
    return plan, edge_link(*priced.edge), *numbers


def _add_open_edges(plans: PlanDifference, builder: AnswerBuilder) -> None:
    """Report the edges that would change between open and closed."""
    now, then = plans.old.open_edges, plans.new.open_edges
    count, before = (sum(p >= OPEN_ABOVE for p in each.values()) for each in (then, now))
    builder.add_line(f"Of {len(then)} edges that were ever seen blocked {count} would count as open, now {before}.")
    changed = presence_changes(now, then, {edge: edge for edge in then})
    builder.add_presence_changes("p open now", "p open then", changed)
