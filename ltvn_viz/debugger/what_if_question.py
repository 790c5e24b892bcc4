"""What would have been otherwise: old and new plan side by side, and what other thresholds would do to the map."""

from collections.abc import Hashable
from functools import partial
from html import escape
from itertools import pairwise
from typing import assert_never

from ltvn_core import palette
from ltvn_core.analysis.planner_state import planner_state_at
from ltvn_core.analysis.what_if_changes import (
    WhatIfChange,
    WithBelief,
    WithEdge,
    WithGoal,
    WithoutEdge,
    WithStart,
    WithThreshold,
)
from ltvn_core.analysis.what_if_parser import format_what_if_change, parse_what_if_change
from ltvn_core.analysis.what_if_replanning import EdgeCostParts, PlanDifference
from ltvn_core.errors import OptionError
from ltvn_core.graph.planner import GraphPath
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_weighting import edge_weighting
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.debugger.what_if_planning import (
    WhatIfOutcome,
    WhatIfResult,
    count_rebuilt_nodes,
    plan_both_ways,
    with_imagined_thresholds,
)
from ltvn_viz.session.commands import PointAt, SubmitText
from ltvn_viz.session.inspection import QuestionAnswer, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, Stroke, stroke

_ROWS = 12
_FORGET, _ALL = "forget ", "all"


class WhatIfQuestion:
    """Imagines changes, and never makes them."""

    about = "Imagine an edge, a belief, the goal or a threshold to be otherwise. The map and the recording stay as is."

    def __init__(self) -> None:
        """Begin with the world as it is."""
        self._changes: dict[Hashable, WhatIfChange] = {}
        self._told = 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show what is imagined and what would come of it."""
        builder = AnswerBuilder()
        self._offers(context, selection, builder)
        self._imagined(builder)
        overlay = EMPTY_OVERLAY
        if self._changes:
            overlay = self._compared(context, builder)
            self._rebuilt(context, builder)
        return builder.build(overlay, input_hint="What if (D_c = 1.3, R_p = 0.3, goal 120 …)")

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Imagine one thing more, or "forget" one or "all". Raises OptionError, MapError."""
        words = " ".join(text.split())
        if words.startswith(_FORGET):
            self._forget(words.removeprefix(_FORGET))
        else:
            change = parse_what_if_change(words)
            self._changes.pop(_about(change), None)
            self._changes[_about(change)] = change
        self._told += 1

    def _forget(self, text: str) -> None:
        kept = (
            {}
            if text == _ALL
            else {key: each for key, each in self._changes.items() if format_what_if_change(each) != text}
        )
        if len(kept) == len(self._changes) and kept:
            raise OptionError(
                f"{text[:60]!r} is not imagined; {', '.join(map(format_what_if_change, kept.values()))} is."
            )
        self._changes = kept

    @staticmethod
    def _offers(context: DebugContext, selection: Selection, builder: AnswerBuilder) -> None:
        texts = [*_about_edge(context.graph, selection), *_about_node(selection)]
        if texts:
            builder.add_html(
                "<div>What if: " + " · ".join(builder.link(text, SubmitText(text)) for text in texts) + "</div>"
            )
        else:
            builder.add_text(
                "Click a node, then its neighbour, to imagine something about the edge between, or type below."
            )

    def _imagined(self, builder: AnswerBuilder) -> None:
        for each in self._changes.values():
            text = format_what_if_change(each)
            builder.add_html(f"<div><b>{escape(text)}</b> · {builder.link('forget', SubmitText(_FORGET + text))}</div>")
        if len(self._changes) > 1:
            builder.add_html(f"<div>{builder.link('forget all', SubmitText(_FORGET + _ALL))}</div>")

    def _compared(self, context: DebugContext, builder: AnswerBuilder) -> Overlay:
        graph, situation, changes = context.graph, planner_state_at(context.timeline, context.instant), self._all
        how = edge_weighting(context)
        known = (
            context.timeline.change_count_before(context.timeline.count_until(context.instant)),
            situation.source,
            situation.goal,
        )
        question = "what if", context.name, self._told, *known, *situation.failures.items()
        plan = partial(plan_both_ways, graph, situation, context.method, changes, how.edge_weight_of)
        outcome: WhatIfOutcome | None = context.in_background(question, plan)
        if outcome is None:
            builder.add_pending("Planning both ways")
            return EMPTY_OVERLAY
        if isinstance(outcome, str):
            builder.add_text(outcome)
            return EMPTY_OVERLAY
        if how.note:
            builder.add_text(how.note)
        _say(outcome, builder)
        return _overlay(context, outcome.plans)

    @property
    def _all(self) -> tuple[WhatIfChange, ...]:
        return tuple(self._changes.values())

    def _rebuilt(self, context: DebugContext, builder: AnswerBuilder) -> None:
        changed = with_imagined_thresholds(context.method, self._all)
        if changed is None:
            return
        if context.live_map is None:
            builder.add_text("How many nodes a rebuild would make is counted live only, where all images are at hand.")
            return
        question = "dry run", self._told
        counted = context.in_background(question, count_rebuilt_nodes(context, changed))
        if counted is None:
            builder.add_pending(
                "Building two maps to compare, without using either, which takes tens of seconds while tasks wait"
            )
        else:
            builder.add_html(f"<div>Rebuilt so: <b>{escape(counted)}</b></div>")


def _about(change: WhatIfChange) -> Hashable:
    """Return what a change is about; a later one about the same takes its place."""
    match change:
        case WithEdge(source, target) | WithoutEdge(source, target):
            return "there", source, target
        case WithBelief(source, target, p):
            return "mu" if p is None else "p", source, target
        case WithThreshold(threshold):
            return threshold
        case WithGoal() | WithStart():
            return type(change)
    assert_never(change)


def _about_edge(graph: TopologicalGraph, selection: Selection) -> tuple[str, ...]:
    edge = selection.edge or selection.pair
    if edge is None:
        return ()
    name = f"{edge[0]}->{edge[1]}"
    if edge not in graph.edges:
        return (f"with {name}",)
    return f"without {name}", f"p({name}) = 0.1", f"p({name}) = 0.9"


def _about_node(selection: Selection) -> tuple[str, ...]:
    return () if selection.node is None else (f"goal {selection.node}", f"from {selection.node}")


def _say(answer: WhatIfResult, builder: AnswerBuilder) -> None:
    plans = answer.plans
    if answer.pruned is not None:
        builder.add_text(answer.pruned.sentence)
    for note in plans.notes:
        builder.add_text(note)
    asked = answer.asked
    if asked.source is not None and asked.goal is not None:
        builder.add_html(f"<div>From {asked.source} to {asked.goal}: <b>{escape(plans.sentence)}</b></div>")
        _table(plans, builder)


def _table(plans: PlanDifference, builder: AnswerBuilder) -> None:
    rows = [_row(builder, "old", each) for each in plans.old_edges if each.edge in plans.removed_edges]
    rows += [_row(builder, "new", each) for each in plans.new_edges if each.edge in plans.added_edges]
    if not rows:
        known = {each.edge: each for each in plans.old_edges}
        rows = [_row(builder, "now", each) for each in plans.new_edges if known.get(each.edge) != each]
    if rows:
        builder.add_table(("plan", "edge", "length", "doubt", "failed"), rows[:_ROWS])


def _row(builder: AnswerBuilder, plan: str, priced: EdgeCostParts) -> tuple[str, ...]:
    source, target = priced.edge
    numbers = (f"{each:.2f}" for each in (priced.mu, priced.doubt, priced.penalty))
    return plan, builder.link(f"{source} → {target}", PointAt(source, target)), *numbers


def _overlay(context: DebugContext, plans: PlanDifference) -> Overlay:
    strokes = (
        *_strokes(context, plans.old, palette.PLAN),
        *_strokes(context, plans.new, palette.EDGE_ADDED, plans.added_edges),
    )
    return Overlay(strokes) if strokes else EMPTY_OVERLAY


def _strokes(
    context: DebugContext, path: GraphPath, colour: Rgb8, only: tuple[EdgeKey, ...] | None = None
) -> tuple[Stroke, ...]:
    keys = [key for key in pairwise(path.nodes) if only is None or key in only]
    ends = [(context.pose(source), context.pose(target)) for source, target in keys]
    return tuple(stroke(start, end, colour) for start, end in ends if start is not None and end is not None)
