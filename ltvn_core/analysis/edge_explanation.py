"""Explains why an edge or a node is in the map, was removed, or is missing, and why p of an edge is low.

Owns the order and the text of the sentences. Uses only what the robot itself knew; `ltvn_core.evaluation` compares with
the ground truth and finds the causes of failed episodes. `analysis.plan_explanation` explains why a plan used an edge.
"""

from collections.abc import Iterator

from ltvn_core.analysis.edge_story import EdgeRow, EdgeStory, edge_story
from ltvn_core.analysis.plan_explanation import CAUSE_TEXTS, Reason, belief_text
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.config import BeliefConfig, BuildingConfig
from ltvn_core.graph.deltas import BULK_CAUSES, Cause, EdgeAdded, FramesReserved, NodeAdded, NodeDropped
from ltvn_core.navigation.events import Localised
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId


def explain_node(timeline: Timeline, node: NodeId, *, at: Instant | None = None) -> tuple[Reason, ...]:
    """Explain why a node is in the map at an instant, and how plans used it; at the end of the run without an instant.

    Linear in the events.
    """
    count = timeline.count_until(at)
    came = [change for change in timeline.changes_of_node(node) if change.event < count]
    if not came:
        return tuple(_never(timeline, node, count))
    plans = [plan for plan in timeline.plans if plan.event < count and node in plan.planned.nodes]
    use = Reason("No plan has led through it yet.")
    if plans:
        last = plans[-1]
        text = f"{count_text(len(plans), 'plan')} led through it, the last one in query {last.planned.query}."
        use = Reason(text, last.instant)
    return (*(reason for change in came for reason in _moved(timeline, change, node)), use)


def _never(timeline: Timeline, node: NodeId, count: int) -> Iterator[Reason]:
    yield Reason(f"Image {node} has never been a node.")
    for change in timeline.changes[: timeline.change_count_before(count)]:
        if isinstance(change.delta, FramesReserved) and node in change.delta.frames:
            text = f"It was put in the reserve {CAUSE_TEXTS[change.delta.cause]}; it can still become a node."
            yield Reason(text, change.instant)


def _moved(timeline: Timeline, change: MapChange, node: NodeId) -> Iterator[Reason]:
    cause = change.delta.cause
    if isinstance(change.delta, NodeAdded):
        yield Reason(f"Node {node} was added {CAUSE_TEXTS[cause]}.", change.instant)
        yield from _circumstances(timeline, change, node, cause)
        tied = _tied(timeline, change, node)
        text = f"It was joined with {count_text(len(tied), 'node')}" + ": " * bool(tied) + ", ".join(map(str, tied[:8]))
        yield Reason(text + ("..." if len(tied) > 8 else "."), change.instant)
    elif isinstance(change.delta, NodeDropped):
        yield Reason(f"Node {node} was removed {CAUSE_TEXTS[cause]}.", change.instant)


def _circumstances(timeline: Timeline, change: MapChange, node: NodeId, cause: Cause) -> Iterator[Reason]:
    """Yield the circumstances in which a node was added during a query."""
    query = timeline.query_at(change.event)
    if query is None or cause not in (Cause.EXPAND, Cause.NOVEL):
        return
    events = (stamped.event for stamped in timeline.events[query.first : change.event])
    localisations = [event for event in events if isinstance(event, Localised)]
    if cause is Cause.EXPAND and localisations and localisations[-1].node is not None:
        start = localisations[-1].node
        text = f"In query {query.id} no path led from node {start} to {query.goal}; a path through image {node} did."
        yield Reason(text, change.instant)
    elif cause is Cause.NOVEL:
        known = max((k + 1 for k, each in enumerate(localisations) if each.node is not None), default=0)
        lost = count_text(len(localisations) - known, "look")
        yield Reason(f"In query {query.id} the robot had not recognised anything in {lost}.", change.instant)


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


def explain_edge(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    *,
    at: Instant | None = None,
    believing: BeliefConfig | None = None,
    seen: tuple[float, float] | None = None,
    thresholds: BuildingConfig | None = None,
) -> tuple[Reason, ...]:
    """Explain the belief of an edge at an instant, or why it is gone or missing; at the end of the run without one.

    The attempts along it are in `edge_story`. Linear in the plans and in the changes of the edge; for an edge that
    never was in the map, in those of the map.

    Args:
        timeline: The run.
        source: Node at which the edge begins.
        target: Node to which it leads.
        at: The instant.
        believing: Rules of belief; with them, the explanation of a pruned edge names R_p.
        seen: (r, d) of the pair as a predictor sees it now, for an edge that never was in the map.
        thresholds: Thresholds of the map; with `seen`, the explanation names the one that prevents the edge.
    """
    story = edge_story(timeline, source, target, at)
    if not story.life:
        return tuple(_missing(timeline, story, at, seen, thresholds))
    last = _belief(story) if story.end is None else _removal(story, story.end, believing)
    return (*_steps(story), last)


def _missing(
    timeline: Timeline,
    story: EdgeStory,
    at: Instant | None,
    seen: tuple[float, float] | None,
    thresholds: BuildingConfig | None,
) -> Iterator[Reason]:
    graph = timeline.graph_at(at)
    source, target = story.source, story.target
    yield Reason(f"There has never been an edge {source} -> {target}.")
    absent = [node for node in (source, target) if node not in graph.nodes]
    for node in absent:
        yield Reason(f"Node {node} is not in the map{', only in the reserve' * (node in graph.reserve)}.")
    if not absent and (target, source) in graph.edges:
        yield Reason(f"The reverse edge {target} -> {source} exists.")
    if seen is None or thresholds is None:
        return
    reachability, distance = seen
    failed = []
    if reachability <= thresholds.connect_reachability:
        failed.append(f"r = {reachability:.2f} is not above R_c = {thresholds.connect_reachability:.2f}")
    if distance >= thresholds.connect_distance:
        failed.append(f"d = {distance:.2f} is not below D_c = {thresholds.connect_distance:.2f}")
    if failed:
        yield Reason(f"The network would not join them: {' and '.join(failed)}.")
    else:
        yield Reason(
            f"The network would join them (r = {reachability:.2f} and d = {distance:.2f}). Neighbouring images or "
            "odometry contradicted the edge, an image was merged, or the two were never compared."
        )


def _steps(story: EdgeStory) -> Iterator[Reason]:
    """Yield how an edge was added, and the changes of its belief that no attempt made."""
    born, *later = story.life
    assert born.after is not None  # A life begins with an addition.
    driven = f", driven {born.after.attempts} times before" if born.after.attempts else ""
    by_odometry = ", by odometry alone because no image was recognised in the other," * born.after.by_odometry
    how = f"was added {CAUSE_TEXTS[born.cause]}{by_odometry} with {belief_text(born.after.belief)}{driven}."
    yield Reason(f"Edge {story.source} -> {story.target} {how}", born.instant)
    for row in later:
        if row.is_update and row.attempt is None:
            yield Reason(f"Its belief was set {CAUSE_TEXTS[row.cause]}: p {p_change_text(row)}.", row.instant)


def p_change_text(row: EdgeRow) -> str:
    """Return p before and after a step in the life of an edge, each a dash where the map did not have it."""
    return " → ".join("–" if edge is None else f"{edge.belief.p:.2f}" for edge in (row.before, row.after))


def _belief(story: EdgeStory) -> Reason:
    """Return how the belief of an edge followed from all attempts."""
    first, last = story.life[0].after, story.last
    assert first is not None
    assert last is not None
    at = next(row.instant for row in reversed(story.life) if row.seen is None)
    if last.attempts == first.attempts:
        text = f"No attempt has counted since, so its belief is still the first one: {belief_text(last.belief)}."
        return Reason(text, at)
    counts = f"{count_text(last.attempts - first.attempts, 'attempt')} counted, {last.successes - first.successes}"
    return Reason(
        f"{counts} with success: p went from {first.belief.p:.2f} to {last.belief.p:.2f}, length (mu) from "
        f"{first.belief.mu:.2f} to {last.belief.mu:.2f}.",
        at,
    )


def _removal(story: EdgeStory, end: EdgeRow, believing: BeliefConfig | None) -> Reason:
    last = story.last
    assert last is not None
    if end.attempt is not None:
        below = f", below R_p = {believing.prune_below:.2f}," if believing else ""
        failures = count_text(last.attempts - last.successes, "failure")
        text = f"It was pruned after attempt {end.attempt}: p = {last.belief.p:.2f}{below} with {failures}."
    elif end.node is not None:
        text = f"It was removed together with node {end.node}, {CAUSE_TEXTS[end.cause]}."
    elif end.whole_map:
        text = f"It was removed when another map replaced this one, {CAUSE_TEXTS[end.cause]}."
    else:
        text = f"It was pruned {CAUSE_TEXTS[end.cause]}."
    return Reason(text, end.instant)
