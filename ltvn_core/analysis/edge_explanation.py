"""Explains why an edge or a node is in the map, was removed, or is missing, and why p of an edge is low.

Owns the order and the text of the steps. Uses only what the robot itself knew; `ltvn_core.evaluation` compares with the
ground truth and finds the causes of failed episodes. `analysis.plan_explanation` explains why a plan used an edge.
"""

from collections.abc import Iterator
from itertools import groupby, pairwise

from ltvn_core.analysis.edge_history import EdgeAttempt, EdgeHistory, EdgeLifetime, TimedBelief, edge_history
from ltvn_core.analysis.plan_explanation import (
    CAUSE_TEXTS,
    ExplanationKind,
    ExplanationStep,
    belief_text,
    explain_planned_edge,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.config import BeliefConfig
from ltvn_core.graph.deltas import (
    BULK_CAUSES,
    Cause,
    EdgeAdded,
    FramesReserved,
    NodeAdded,
    NodeDropped,
)
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.navigation.events import Localised
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId

__all__ = ["explain_edge_belief", "explain_missing_edge", "explain_node", "explain_planned_edge", "explain_pruned_edge"]


def explain_node(timeline: Timeline, node: NodeId, *, at: Instant | None = None) -> tuple[ExplanationStep, ...]:
    """Explain why a node is in the map at an instant, and how plans used it; at the end of the run without an instant.

    Linear in the events.
    """
    count = timeline.count_until(at)
    came = [change for change in timeline.changes_of_node(node) if change.event < count]
    if not came:
        return tuple(_never(timeline, node, count))
    return tuple(reason for change in came for reason in _moved(timeline, change, node)) + _use(timeline, node, count)


def _never(timeline: Timeline, node: NodeId, count: int) -> Iterator[ExplanationStep]:
    yield ExplanationStep(f"Image {node} has never been a node.", None, ExplanationKind.NEVER, (node,))
    for change in timeline.changes_before(count):
        if isinstance(change.delta, FramesReserved) and node in change.delta.frames:
            text = f"It was put in the reserve {CAUSE_TEXTS[change.delta.cause]}; it can still become a node."
            yield ExplanationStep(text, change.instant, ExplanationKind.NEVER, (node,))


def _moved(timeline: Timeline, change: MapChange, node: NodeId) -> Iterator[ExplanationStep]:
    cause = change.delta.cause
    if isinstance(change.delta, NodeAdded):
        text = f"Node {node} was added {CAUSE_TEXTS[cause]}."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node,))
        yield from _circumstances(timeline, change, node, cause)
        tied = _tied(timeline, change, node)
        text = f"It was joined with {count_text(len(tied), 'node')}" + ": " * bool(tied) + ", ".join(map(str, tied[:8]))
        text += "..." if len(tied) > 8 else "."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node, *tied))
    elif isinstance(change.delta, NodeDropped):
        text = f"Node {node} was removed {CAUSE_TEXTS[cause]}."
        yield ExplanationStep(text, change.instant, ExplanationKind.GONE, (node,))


def _circumstances(timeline: Timeline, change: MapChange, node: NodeId, cause: Cause) -> Iterator[ExplanationStep]:
    """Yield the circumstances in which a node was added during a query."""
    query = timeline.query_at(change.event)
    if query is None or cause not in (Cause.EXPAND, Cause.NOVEL):
        return
    events = (stamped.event for stamped in timeline.events[query.first : change.event])
    localisations = [event for event in events if isinstance(event, Localised)]
    if cause is Cause.EXPAND and localisations and localisations[-1].node is not None:
        start = localisations[-1].node
        text = f"In query {query.id} no path led from node {start} to {query.goal}; a path through image {node} did."
        yield ExplanationStep(text, change.instant, ExplanationKind.PLAN, (start, query.goal))
    elif cause is Cause.NOVEL:
        known = max((k + 1 for k, each in enumerate(localisations) if each.node is not None), default=0)
        lost = count_text(len(localisations) - known, "look")
        text = f"In query {query.id} the robot had not recognised anything in {lost}."
        yield ExplanationStep(text, change.instant, ExplanationKind.BORN, (node,))


def _tied(timeline: Timeline, change: MapChange, node: NodeId) -> tuple[NodeId, ...]:
    """Return the nodes to which a new node was joined when it was added."""
    tied: dict[NodeId, None] = {}
    for number in range(timeline.change_count_before(change.event + 1), len(timeline.changes)):
        later = timeline.changes[number]
        delta = later.delta
        if isinstance(delta, NodeAdded) and delta.cause in BULK_CAUSES:
            continue  # A whole map is added at once, with all other nodes and their edges.
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


def explain_pruned_edge(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    *,
    at: Instant | None = None,
    believing: BeliefConfig | None = None,
) -> tuple[ExplanationStep, ...]:
    """Explain why an edge is no longer in the map at an instant; at the end of the run without an instant.

    With `believing` the explanation names R_p. Linear in the plans and in the changes of the edge.
    """
    history = edge_history(timeline, source, target, at)
    if not history.lifetimes:
        return explain_missing_edge(timeline, source, target, at=at)
    if history.alive:
        text = f"Edge {source} -> {target} is not gone: {belief_text(history.lifetimes[-1].beliefs[-1].belief)}."
        return (
            *_steps(history),
            ExplanationStep(text, history.lifetimes[-1].beliefs[-1].instant, ExplanationKind.BELIEF, (source, target)),
        )
    return (*_steps(history), _departure(history, believing))


def explain_edge_belief(
    timeline: Timeline, source: NodeId, target: NodeId, *, at: Instant | None = None
) -> tuple[ExplanationStep, ...]:
    """Explain the belief of an edge at an instant; if the edge is gone by then, its last belief.

    Linear in the plans and in the changes of the edge.
    """
    history = edge_history(timeline, source, target, at)
    if not history.lifetimes:
        return explain_missing_edge(timeline, source, target, at=at)
    first = history.lifetimes[-1].beliefs[0]
    last = history.lifetimes[-1].beliefs[-1]
    driven = last.attempts - first.attempts
    if not driven:
        text = f"No attempt has counted since, so its belief is still the first one: {belief_text(last.belief)}."
    else:
        won = last.successes - first.successes
        text = (
            f"{count_text(driven, 'attempt')} counted, {won} with success: p went from {first.belief.p:.2f} to "
            f"{last.belief.p:.2f}, length (mu) from {first.belief.mu:.2f} to {last.belief.mu:.2f}."
        )
    verdict = ExplanationStep(text, last.instant, ExplanationKind.BELIEF, (source, target))
    return (*_steps(history), verdict, *(() if history.alive else (_departure(history, None),)))


def explain_missing_edge(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    *,
    at: Instant | None = None,
    seen: tuple[float, float] | None = None,
    thresholds: OperatorThresholds | None = None,
) -> tuple[ExplanationStep, ...]:
    """Explain why an edge is not in the map at an instant.

    `seen` is (r, d) of the pair as a predictor sees it now, `thresholds` the thresholds of the map; if both are given,
    the explanation names the threshold that prevents the edge. Linear in the changes of the map.
    """
    history = edge_history(timeline, source, target, at)
    graph = timeline.graph_at(at)
    ids = (source, target)
    if history.lifetimes:
        return explain_pruned_edge(timeline, source, target, at=at)
    name = f"edge {source} -> {target}"
    absent = [node for node in ids if node not in graph.nodes]
    texts = [f"There has never been an {name}."]
    texts += [f"Node {node} is not in the map{', only in the reserve' * (node in graph.reserve)}." for node in absent]
    if not absent and (target, source) in graph.edges:
        texts.append(f"The reverse edge {target} -> {source} exists.")
    if seen is not None and thresholds is not None:
        texts.append(_gated(*seen, thresholds))
    return tuple(ExplanationStep(text, at, ExplanationKind.NEVER, ids) for text in texts)


def _gated(reachability: float, distance: float, thresholds: OperatorThresholds) -> str:
    """Return which threshold prevents an edge, as text."""
    failed = []
    if reachability <= thresholds.connect_reachability:
        failed.append(f"r = {reachability:.2f} is not above R_c = {thresholds.connect_reachability:.2f}")
    if distance >= thresholds.connect_distance:
        failed.append(f"d = {distance:.2f} is not below D_c = {thresholds.connect_distance:.2f}")
    if failed:
        return f"The network would not join them: {' and '.join(failed)}."
    return (
        f"The network would join them (r = {reachability:.2f} and d = {distance:.2f}). Neighbouring images or "
        "odometry contradicted the edge, an image was merged, or the two were never compared."
    )


def _steps(history: EdgeHistory) -> Iterator[ExplanationStep]:
    """Yield how an edge was added, and one step for each attempt that changed its belief."""
    life = history.lifetimes[-1]
    ids = (history.source, history.target)
    first = life.beliefs[0]
    driven = f", driven {first.attempts} times before" if first.attempts else ""
    cause = CAUSE_TEXTS[life.cause]
    origin = ", by odometry alone because no image was recognised in the other," if life.by_odometry else ""
    text = (
        f"Edge {history.source} -> {history.target} was added {cause}{origin} with {belief_text(first.belief)}{driven}."
    )
    yield ExplanationStep(text, life.added_at, ExplanationKind.BORN, ids)
    until = life.end.instant.step if life.end else None
    rows = [
        row
        for row in history.attempts
        if life.added_at.step <= row.begin.step and (not until or row.begin.step <= until)
    ]
    yield from _attempt_steps(life, rows, ids)


def _attempt_steps(life: EdgeLifetime, rows: list[EdgeAttempt], ids: tuple[NodeId, ...]) -> Iterator[ExplanationStep]:
    changes = {after.attempt: (before, after) for before, after in pairwise(life.beliefs) if after.attempt is not None}
    for query, group in groupby(rows, key=lambda row: row.query):
        counted = []
        silent = []
        for row in group:
            if row.number in changes and row.changed_belief:
                counted.append(row)
                yield _attempt_step(row, *changes[row.number], ids)
            elif row.ended is None:
                text = f"Attempt {row.number} in query {query} has not ended."
                yield ExplanationStep(text, row.begin, ExplanationKind.ATTEMPT, ids)
            else:
                silent.append(row)
        if silent:
            text = _silent_text(silent, counted, query)
            yield ExplanationStep(text, silent[0].begin, ExplanationKind.ATTEMPT, ids)
    for before, after in pairwise(life.beliefs):
        if after.attempt is None:
            text = (
                f"Its belief was set {CAUSE_TEXTS[after.cause]}: p from {before.belief.p:.2f} to {after.belief.p:.2f}."
            )
            yield ExplanationStep(text, after.instant, ExplanationKind.BELIEF, ids)


def _silent_text(rows: list[EdgeAttempt], counted: list[EdgeAttempt], query: int) -> str:
    """Return how many attempts of a query did not change the belief, and the rule behind that if there is one."""
    failed = sum(row.record.failed for row in rows)
    how_many = count_text(len(rows), "more attempt" if counted else "attempt")
    of_these = f" ({failed} failed)" if failed else ""
    is_repeated = failed and any(row.record.failed for row in counted)
    rule = ": of several failures in a query only the first counts" if is_repeated else ""
    return f"{how_many} along it in query {query}{of_these} did not change its belief{rule}."


def _attempt_step(
    row: EdgeAttempt, before: TimedBelief, after: TimedBelief, ids: tuple[NodeId, ...]
) -> ExplanationStep:
    ended = row.ended
    verdict = "failed (cut)" if ended is None else "succeeded" if ended.succeeded else ended.end.failure
    reason = "it has not ended" if ended is None else ended.reason
    change = f"p from {before.belief.p:.2f} to {after.belief.p:.2f}"
    text = f"Attempt {row.number} in query {row.query} {verdict}: {reason}; {change}."
    return ExplanationStep(text, row.record.end or row.begin, ExplanationKind.ATTEMPT, ids)


def _departure(history: EdgeHistory, believing: BeliefConfig | None) -> ExplanationStep:
    life = history.lifetimes[-1]
    ids = (history.source, history.target)
    assert life.end is not None  # Called only for edges that were removed.
    last = life.beliefs[-1]
    if life.end.attempt is not None:
        below = f", below R_p = {believing.prune_below:.2f}," if believing else ""
        failures = count_text(last.attempts - last.successes, "failure")
        text = f"It was pruned after attempt {life.end.attempt}: p = {last.belief.p:.2f}{below} with {failures}."
    elif life.end.node is not None:
        text = f"It was removed together with node {life.end.node}, {CAUSE_TEXTS[life.end.cause]}."
        ids = (*ids, life.end.node)
    elif life.end.whole_map:
        text = f"It was removed when another map replaced this one, {CAUSE_TEXTS[life.end.cause]}."
    else:
        text = f"It was pruned {CAUSE_TEXTS[life.end.cause]}."
    return ExplanationStep(text, life.end.instant, ExplanationKind.GONE, ids)
