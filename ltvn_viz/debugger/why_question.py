"""Why an edge is gone, weak, chosen or missing, and why a node is here, as sentences that lead into time.

Owns which of these questions make sense. The sentences are made in `ltvn_core.analysis.edge_explanation`.
"""

import re
from collections.abc import Sequence
from html import escape
from typing import Never

from ltvn_core import palette
from ltvn_core.analysis import edge_explanation
from ltvn_core.analysis.edge_history import EdgeHistory, edge_history
from ltvn_core.analysis.explanation_steps import ExplanationKind, ExplanationStep, count_text
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.errors import OptionError
from ltvn_core.geometry import distance
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_weighting import edge_weighting
from ltvn_viz.debugger.later_changes import add_later_changes
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.svg_figures import image_figure
from ltvn_viz.session.commands import ChooseQuestion, PointAt
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import Overlay, Stroke, stroke

_SENTENCES = 8
"""Of a longer chain the beginning and the end are reasons."""
_GONE = 12


class WhyQuestion(Question[Never]):
    """Tells the reasons."""

    name = QuestionName.BLAME
    word = QuestionName.BLAME.word
    is_for_watchers = True
    about = (
        "The reasons behind an edge or a node, each with its moment. Click a node, then another, or type two numbers."
    )

    def __init__(self) -> None:
        """Begin with nothing typed."""
        self._typed: EdgeKey | None = None
        self._under = NOTHING_SELECTED

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether there ever was a map."""
        return len(context.timeline.changes) > 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Tell why the edge or the node is as it is at the moment."""
        if selection != self._under:
            self._under, self._typed = selection, None
        builder, input_hint = AnswerBuilder(), "From node, to node"
        edge = self._typed or selection.edge
        if edge is not None:
            self._edge(context, edge, builder)
            return builder.build(_overlay(context, edge), input_hint)
        if selection.node is None:
            builder.add_text("Click a node in the scene, then its neighbour; or type two numbers to ask about an edge.")
            return builder.build(input_hint=input_hint)
        self._node(context, selection.node, selection.before, builder)
        return builder.build(Overlay(nodes={selection.node: palette.SOURCE}), input_hint)

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Ask about the edge between two nodes."""
        numbers = [int(number) for number in re.findall(r"\d+", text)]
        if len(numbers) != 2 or numbers[0] == numbers[1]:
            raise OptionError("Type the numbers of two different nodes, from and to, for instance: 12 40.")
        self._typed = numbers[0], numbers[1]

    def _node(self, context: DebugContext, node: NodeId, before: NodeId | None, builder: AnswerBuilder) -> None:
        self._chain(
            context,
            f"Why is node {node} here?",
            edge_explanation.explain_node(context.timeline, node, at=context.instant),
            builder,
        )
        self._views(context, node, builder)
        if before not in (None, node):
            asked = builder.link(f"Why is there no edge {before} → {node}?", PointAt(before, node))
            builder.add_html(f"<div>{asked}</div>")
        gone = dict.fromkeys(
            mark.ids for mark in context.timeline.marks_until(context.instant, MarkKind.PRUNE) if node in mark.ids[:2]
        )
        links = [builder.link(f"{ids[0]} → {ids[1]}", PointAt(*ids)) for ids in [*gone][-_GONE:] if len(ids) == 2]
        if links:
            builder.add_html(f"<div>Edges that were pruned here: {', '.join(links)}.</div>")

    @staticmethod
    def _views(context: DebugContext, node: NodeId, builder: AnswerBuilder) -> None:
        """Show how the place looked when it became a node, and how at other times."""
        if not (views := context.graph.views.get(node, ())):
            return
        captions = {node: "when the map was made"} | {
            view.frame: f"view {view.frame}, used in {count_text(view.uses, 'query', 'queries')}" for view in views
        }
        images = (
            image_figure(context.observation(frame), caption, context.camera) for frame, caption in captions.items()
        )
        builder.add_html(f'<div class="lt-pair">{"".join(images)}</div>')

    def _edge(self, context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> None:
        back = builder.link("the way back", PointAt(edge[1], edge[0]))
        closer = builder.link("look closer", ChooseQuestion(QuestionName.EDGE))
        builder.add_html(
            f"<div>Edge <b>{edge[0]} → {edge[1]}</b> · {back}{f' · {closer}' if self._typed is None else ''}</div>"
        )
        story = edge_history(context.timeline, *edge, context.instant)
        if not story.lifetimes:
            self._chain(context, "Why is it missing?", self._missing(context, edge), builder)
        elif story.alive:
            self._chain(
                context,
                _doubt(story),
                edge_explanation.explain_edge_belief(context.timeline, *edge, at=context.instant),
                builder,
            )
        else:
            reasons = edge_explanation.explain_pruned_edge(
                context.timeline, *edge, at=context.instant, believing=context.method.believing
            )
            self._chain(context, "Why is it gone?", reasons, builder)
        add_later_changes(context, story, builder)
        if story.planned_at:
            self._chosen(context, edge, story, builder)
        elif story.lifetimes:
            builder.add_text("No plan has led through it yet.")

    def _missing(self, context: DebugContext, edge: EdgeKey) -> Sequence[ExplanationStep]:
        seen, thresholds = _seen(context, edge), OperatorThresholds.building(context.method.building)
        return edge_explanation.explain_missing_edge(
            context.timeline, *edge, at=context.instant, seen=seen, thresholds=thresholds
        )

    def _chosen(self, context: DebugContext, edge: EdgeKey, story: EdgeHistory, builder: AnswerBuilder) -> None:
        timeline, planning, last = context.timeline.copy(), context.method.planning, story.planned_at[-1]
        how = edge_weighting(context)
        weight = how.edge_weight_of(context.method)
        # Planning again takes time on a large map, and the answer stays as long as no newer plan comes.
        reasons = context.in_background(
            ("chosen", context.name, context.start_s, edge, last),
            lambda: edge_explanation.explain_planned_edge(timeline, *edge, planning, at=last, weight=weight),
        )
        title = "Why was it chosen?"
        if reasons is None:
            builder.add_pending("Planning once more without it", title=title)
        else:
            self._chain(context, title, reasons, builder)
            if how.note:
                builder.add_text(how.note)

    @staticmethod
    def _chain(context: DebugContext, title: str, reasons: Sequence[ExplanationStep], builder: AnswerBuilder) -> None:
        builder.add_html(f"<div><b>{escape(title)}</b></div>")
        left_out = len(reasons) - _SENTENCES
        for number, reason in enumerate(reasons):
            if left_out > 0 and 1 <= number <= left_out:
                if number == 1:
                    builder.add_text(f"… {left_out} more like these …")
                continue
            # What never happened has no moment of its own.
            at = None if reason.kind is ExplanationKind.NEVER else reason.instant
            when = "" if at is None else builder.time_link(context.seconds(at)) + " "
            builder.add_html(f"<div>{when}{escape(reason.text.replace('->', '→'))}</div>")


def _doubt(story: EdgeHistory) -> str:
    belief = story.lifetimes[-1].beliefs[-1].belief
    return f"Why is it so weak, p = {belief.p:.2f}?" if belief.p < 0.5 else f"Why is p = {belief.p:.2f}?"


def _seen(context: DebugContext, edge: EdgeKey) -> tuple[float, float] | None:
    """Return (r, d) of the pair as the network in use sees it; None without images or as long as it is at work."""
    views = [context.observation(node) for node in edge]
    pictures = [image for seen in views if seen is not None and (image := context.view.of(seen)) is not None]
    predictor = context.predictor
    if len(pictures) < len(views):
        return None

    def compare() -> tuple[float, float]:
        features = predictor.encode(pictures)
        said = predictor.predict(features[:1], features[1:])
        return float(said.reachability[0]), float(distance(said.waypoints)[0])

    return context.in_background(("pair", context.name, predictor.fingerprint, edge), compare)


def _overlay(context: DebugContext, edge: EdgeKey) -> Overlay:
    start, end = (context.pose(node) for node in edge)
    strokes: tuple[Stroke, ...] = ()
    if start is not None and end is not None:
        strokes = (stroke(start, end, palette.TARGET),)
    return Overlay(strokes=strokes, nodes={edge[0]: palette.SOURCE, edge[1]: palette.TARGET})
