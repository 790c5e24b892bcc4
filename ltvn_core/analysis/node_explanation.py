"""Explains why a node is in the map, or is not, step by step.

Owns the steps for nodes; those for edges are `analysis.edge_explanation` and `analysis.plan_alternative`.
"""

from collections.abc import Iterator

from ltvn_core.analysis.explanation_steps import CAUSE_TEXTS, ExplanationKind, ExplanationStep, count_text
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.graph.deltas import (
    Cause,
    EdgeAdded,
    FramesReserved,
    GraphDelta,
    NodeAdded,
    NodeDropped,
    ViewAdded,
    ViewDropped,
    ViewUsed,
)
from ltvn_core.navigation.events import Localised
from ltvn_core.types import NodeId


def explain_node(timeline: Timeline, node: NodeId, *, at: Instant | None = None) -> tuple[ExplanationStep, ...]:
    """Tell why a node is in the map at an instant, and what it was good for; at the end without one.

    Linear in the events.
    """
    count = timeline.count_until(at)
    came = [change for change in timeline.changes_of_node(node) if change.event < count]
    if not came:
        return tuple(_never(timeline, node, count))
    return tuple(reason for change in came for reason in _moved(timeline, change, node)) + _use(timeline, node, count)


def _never(timeline: Timeline, node: NodeId, count: int) -> Iterator[ExplanationStep]:
    yield ExplanationStep(f"Image {node} never was a node.", None, ExplanationKind.NEVER, (node,))
    for change in timeline.changes_before(count):
        if isinstance(change.delta, FramesReserved) and node in change.delta.frames:
            text = f"It was put in the reserve {CAUSE_TEXTS[change.delta.cause]}, from where it can still become one."
            yield ExplanationStep(text, change.instant, ExplanationKind.NEVER, (node,))


def _moved(timeline: Timeline, change: MapChange, node: NodeId) -> Iterator[ExplanationStep]:
    cause = change.delta.cause
    if isinstance(change.delta, NodeAdded):
        text = f"Node {node} came in {CAUSE_TEXTS[cause]}."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node,))
        yield from _circumstances(timeline, change, node, cause)
        tied = _tied(timeline, change, node)
        text = f"It was joined with {count_text(len(tied), 'node')}" + ": " * bool(tied) + ", ".join(map(str, tied[:8]))
        text += "..." if len(tied) > 8 else "."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node, *tied))
    elif isinstance(change.delta, NodeDropped):
        text = f"Node {node} left {CAUSE_TEXTS[cause]}."
        yield ExplanationStep(text, change.instant, ExplanationKind.GONE, (node,))
    elif (view := _view_text(change.delta)) is not None:
        yield ExplanationStep(view, change.instant, ExplanationKind.BELIEF, (node,))


def _view_text(delta: GraphDelta) -> str | None:
    match delta:
        case ViewAdded(view=view, cause=Cause.LOAD):
            return f"It came with image {view.frame} as a view, used in {count_text(view.uses, 'query', 'queries')}."
        case ViewAdded(view=view):
            return f"It looked different from image {view.frame}, where odometry put the robot here: a view of it now."
        case ViewUsed(frame=frame):
            return f"The robot recognised it by its view {frame}."
        case ViewDropped(frame=frame):
            return f"Its view {frame} was the least useful one and made room."
        case _:
            return None


def _circumstances(timeline: Timeline, change: MapChange, node: NodeId, cause: Cause) -> Iterator[ExplanationStep]:
    """Yield what the robot was about when a node came in under way."""
    query = timeline.query_at(change.event)
    if query is None or cause not in (Cause.EXPAND, Cause.NOVEL):
        return
    events = (stamped.event for stamped in timeline.events[query.first : change.event])
    localisations = [event for event in events if isinstance(event, Localised)]
    if cause is Cause.EXPAND and localisations and localisations[-1].node is not None:
        start = localisations[-1].node
        text = f"In query {query.id} no path led from node {start} to {query.goal}; a way through image {node} did."
        yield ExplanationStep(text, change.instant, ExplanationKind.PLAN, (start, query.goal))
    elif cause is Cause.NOVEL:
        known = max((k + 1 for k, each in enumerate(localisations) if each.node is not None), default=0)
        lost = count_text(len(localisations) - known, "look")
        text = f"In query {query.id} the robot had not recognised anything in {lost}."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node,))


def _tied(timeline: Timeline, change: MapChange, node: NodeId) -> tuple[NodeId, ...]:
    """Return the nodes that a new one was joined with at once."""
    tied: dict[NodeId, None] = {}
    for number in range(timeline.change_count_before(change.event + 1), len(timeline.changes)):
        later = timeline.changes[number]
        delta = later.delta
        if isinstance(delta, NodeAdded) and delta.cause is Cause.LOAD:
            continue  # A file's map tells all its nodes before its edges.
        if later.instant != change.instant or not isinstance(delta, EdgeAdded):
            break
        if delta.edge.source == node:
            tied[delta.edge.target] = None
    return tuple(tied)


def _use(timeline: Timeline, node: NodeId, count: int) -> tuple[ExplanationStep, ...]:
    plans = [plan for plan in timeline.plans if plan.event < count and node in plan.planned.nodes]
    if not plans:
        return (ExplanationStep("No plan has led through it yet.", None, ExplanationKind.PLAN, (node,)),)
    text = f"{count_text(len(plans), 'plan')} led through it, the last one in query {plans[-1].planned.query}."
    return (ExplanationStep(text, plans[-1].instant, ExplanationKind.PLAN, (node,)),)
