"""Why an edge is gone, weak, chosen or missing, and why a node exists, as sentences with links to the moments.

Owns the choice of explanations for an edge. `ltvn_core.analysis.edge_explanation` writes the sentences.
"""

from collections.abc import Sequence

from ltvn_core.analysis import edge_explanation
from ltvn_core.analysis.answer import Inline, Link, Strong, joined
from ltvn_core.analysis.edge_history import EdgeHistory
from ltvn_core.analysis.plan_explanation import ExplanationKind, ExplanationStep
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.geometry import distance
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, edge_link, time_link
from ltvn_viz.wishes.commands import PointAt

_SENTENCES = 8
"""Maximum number of sentences; of a longer chain, only the beginning and the end are shown."""
_GONE = 12


def add_node_reasons(context: DebugContext, node: NodeId, before: NodeId | None, builder: AnswerBuilder) -> None:
    """Explain why a node exists, and link its missing edges; `before` was selected before it."""
    _chain(
        context,
        f"Why is node {node} in the map?",
        edge_explanation.explain_node(context.timeline, node, at=context.instant),
        builder,
    )
    if before not in (None, node):
        builder.add_line(Link(f"Why is there no edge {before} → {node}?", PointAt(before, node)))
    gone = dict.fromkeys(
        mark.ids for mark in context.timeline.marks_until(context.instant, MarkKind.PRUNE) if node in mark.ids[:2]
    )
    links = [edge_link(*ids) for ids in [*gone][-_GONE:] if len(ids) == 2]
    if links:
        builder.add_line("Edges that were pruned here: ", joined(links, ", "), ".")


def add_edge_reasons(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    """Explain why an edge is missing, was removed, or has its p, and why the last plan through it was made."""
    edge = story.source, story.target
    if not story.lifetimes:
        _chain(context, "Why is it missing?", _missing(context, edge), builder)
    elif story.alive:
        p = story.lifetimes[-1].beliefs[-1].belief.p
        title = f"Why is its belief so low, p = {p:.2f}?" if p < 0.5 else f"Why is p = {p:.2f}?"
        reasons = edge_explanation.explain_edge_belief(context.timeline, *edge, at=context.instant)
        _chain(context, title, reasons, builder)
    else:
        reasons = edge_explanation.explain_pruned_edge(
            context.timeline, *edge, at=context.instant, believing=context.method.believing
        )
        _chain(context, "Why is it gone?", reasons, builder)
    if story.planned_at:
        _chosen(context, edge, story, builder)
    elif story.lifetimes:
        builder.add_line("No plan has led through it yet.")


def _missing(context: DebugContext, edge: EdgeKey) -> Sequence[ExplanationStep]:
    seen = _seen(context, edge)
    thresholds = OperatorThresholds.building(context.method.building)
    return edge_explanation.explain_missing_edge(
        context.timeline, *edge, at=context.instant, seen=seen, thresholds=thresholds
    )


def _chosen(context: DebugContext, edge: EdgeKey, story: EdgeHistory, builder: AnswerBuilder) -> None:
    timeline = context.timeline.copy()
    last = story.planned_at[-1]
    rules = context.rules
    # Replanning is slow on a large map, and the answer stays valid until the next plan.
    reasons = context.in_background(
        ("chosen", context.name, context.start_s, edge, last),
        lambda: edge_explanation.explain_planned_edge(timeline, *edge, rules, at=last),
    )
    title = "Why was it chosen?"
    if reasons is None:
        builder.add_pending("Planning once more without it", title=title)
    else:
        _chain(context, title, reasons, builder)
        if context.rules_note:
            builder.add_line(context.rules_note)


def _chain(context: DebugContext, title: str, reasons: Sequence[ExplanationStep], builder: AnswerBuilder) -> None:
    builder.add_line(Strong(title))
    left_out = len(reasons) - _SENTENCES
    for number, reason in enumerate(reasons):
        if left_out > 0 and 1 <= number <= left_out:
            if number == 1:
                builder.add_line(f"… {left_out} more like these …")
            continue
        # An event that never happened has no moment.
        at = None if reason.kind is ExplanationKind.NEVER else reason.instant
        when: list[Inline] = [] if at is None else [time_link(context.seconds(at)), " "]
        builder.add_line(when, reason.text.replace("->", "→"))


def _seen(context: DebugContext, edge: EdgeKey) -> tuple[float, float] | None:
    """Return (r, d) of the pair by the network in use; None without images or while it is computed."""
    views = [context.observation(node) for node in edge]
    pictures = [image for seen in views if seen is not None and (image := context.as_compared(seen)) is not None]
    predictor = context.predictor
    if len(pictures) < len(views):
        return None

    def compare() -> tuple[float, float]:
        features = predictor.encode(pictures)
        said = predictor.predict(features[:1], features[1:])
        return float(said.reachability[0]), float(distance(said.waypoints)[0])

    return context.in_background(("pair", context.name, predictor.fingerprint, edge), compare)
