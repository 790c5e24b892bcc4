"""Why an edge is gone, so weak, or missing: the chain of changes and attempts behind it.

Answers the other two questions, too: why an edge was `chosen` and why a node is here, from `analysis.choice` and
`analysis.arrivals`. Owns the order and the words of its own chains, which come from what the robot itself knew. What
was truly so, and whose fault a failed episode was, is the business of `ltvn_core.evaluate`.
"""

from collections.abc import Iterator
from itertools import groupby, pairwise

from ltvn_core.analysis.arrivals import node_here
from ltvn_core.analysis.choice import chosen
from ltvn_core.analysis.edges import AttemptRow, BeliefAt, EdgeLife, EdgeStory, edge_story
from ltvn_core.analysis.reasons import CAUSES, Reason, ReasonKind, counted, said
from ltvn_core.analysis.timeline import Instant, Timeline
from ltvn_core.config import Believing
from ltvn_core.graph.operators import Gates
from ltvn_core.types import NodeId

__all__ = ["chosen", "gone", "missing", "node_here", "weak"]


def gone(
    timeline: Timeline, source: NodeId, target: NodeId, *, at: Instant | None = None, believing: Believing | None = None
) -> tuple[Reason, ...]:
    """Tell why an edge is no longer in the map at an instant; at the end without one.

    With `believing` it names R_p. Linear in plans and in what happened to the edge.
    """
    story = edge_story(timeline, source, target, at)
    if not story.lives:
        return missing(timeline, source, target, at=at)
    if story.alive:
        text = f"Edge {source} -> {target} is not gone: {said(story.lives[-1].history[-1].belief)}."
        return (*_chain(story), Reason(text, story.lives[-1].history[-1].instant, ReasonKind.BELIEF, (source, target)))
    return (*_chain(story), _departure(story, believing))


def weak(timeline: Timeline, source: NodeId, target: NodeId, *, at: Instant | None = None) -> tuple[Reason, ...]:
    """Tell how the belief of an edge came to be what it is at an instant, or what it was last.

    Linear in plans and in what happened to the edge.
    """
    story = edge_story(timeline, source, target, at)
    if not story.lives:
        return missing(timeline, source, target, at=at)
    first, last = story.lives[-1].history[0], story.lives[-1].history[-1]
    driven = last.attempts - first.attempts
    if not driven:
        text = f"No attempt has counted since, so that its belief is as it came in: {said(last.belief)}."
    else:
        won = last.successes - first.successes
        text = (
            f"{counted(driven, 'attempt')} counted, {won} with success: p went from {first.belief.p:.2f} to "
            f"{last.belief.p:.2f}, mu from {first.belief.mu:.2f} to {last.belief.mu:.2f}."
        )
    verdict = Reason(text, last.instant, ReasonKind.BELIEF, (source, target))
    return (*_chain(story), verdict, *(() if story.alive else (_departure(story, None),)))


def missing(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    *,
    at: Instant | None = None,
    seen: tuple[float, float] | None = None,
    gates: Gates | None = None,
) -> tuple[Reason, ...]:
    """Tell why there is no edge at an instant.

    `seen` is (r, d) of the pair as a predictor sees it now, `gates` the thresholds of the map; with both it tells which
    of them is in the way. Linear in the changes of the map.
    """
    story, graph, ids = edge_story(timeline, source, target, at), timeline.graph_at(at), (source, target)
    if story.lives:
        return gone(timeline, source, target, at=at)
    name = f"edge {source} -> {target}"
    absent = [node for node in ids if node not in graph.nodes]
    texts = [f"There never was an {name}."]
    texts += [f"Node {node} is not in the map{', only in the reserve' * (node in graph.reserve)}." for node in absent]
    if not absent and (target, source) in graph.edges:
        texts.append(f"The way back is there: edge {target} -> {source}.")
    if seen is not None and gates is not None:
        texts.append(_gated(*seen, gates))
    return tuple(Reason(text, at, ReasonKind.NEVER, ids) for text in texts)


def _gated(reachability: float, distance: float, gates: Gates) -> str:
    """Say which threshold is in the way of an edge."""
    failed = []
    if reachability <= gates.connect_reachability:
        failed.append(f"r = {reachability:.2f} is not above R_c = {gates.connect_reachability:.2f}")
    if distance >= gates.connect_distance:
        failed.append(f"d = {distance:.2f} is not below D_c = {gates.connect_distance:.2f}")
    if failed:
        return f"The network would not join them: {' and '.join(failed)}."
    return (
        f"The network would join them, r = {reachability:.2f} and d = {distance:.2f}; support by neighbouring images, "
        "odometry or merging spoke against it, or the two were never compared."
    )


def _chain(story: EdgeStory) -> Iterator[Reason]:
    """Yield the birth of an edge and what driving taught, one sentence per query and verdict that counted."""
    life, ids = story.lives[-1], (story.source, story.target)
    first = life.history[0]
    driven = f", driven {first.attempts} times before" if first.attempts else ""
    text = f"Edge {story.source} -> {story.target} came in {CAUSES[life.cause]} with {said(first.belief)}{driven}."
    yield Reason(text, life.born, ReasonKind.BORN, ids)
    yield from _lessons(life, _within(story, life), ids)


def _within(story: EdgeStory, life: EdgeLife) -> list[AttemptRow]:
    until = life.end.instant.step if life.end else None
    return [
        row for row in story.attempts if life.born.step <= row.begin.step and (not until or row.begin.step <= until)
    ]


def _lessons(life: EdgeLife, rows: list[AttemptRow], ids: tuple[NodeId, ...]) -> Iterator[Reason]:
    taught = {after.attempt: (before, after) for before, after in pairwise(life.history) if after.attempt is not None}
    for query, group in groupby(rows, key=lambda row: row.query):
        silent = []
        for row in group:
            if row.attempt in taught and row.counted:
                yield _lesson(row, *taught[row.attempt], ids)
            else:
                silent.append(row)
        if silent:
            failed = sum(row.succeeded is False for row in silent)
            text = f"{counted(len(silent), 'more leg')} along it in query {query}, {failed} failed, taught nothing."
            yield Reason(text, silent[0].begin, ReasonKind.ATTEMPT, ids)
    for before, after in pairwise(life.history):
        if after.attempt is None:
            text = f"Its belief was set {CAUSES[after.cause]}: p from {before.belief.p:.2f} to {after.belief.p:.2f}."
            yield Reason(text, after.instant, ReasonKind.BELIEF, ids)


def _lesson(row: AttemptRow, before: BeliefAt, after: BeliefAt, ids: tuple[NodeId, ...]) -> Reason:
    verdict = "succeeded" if row.succeeded else f"failed ({row.end.value if row.end else 'cut'})"
    change = f"p from {before.belief.p:.2f} to {after.belief.p:.2f}"
    text = f"Attempt {row.attempt} in query {row.query} {verdict}: {row.reason}; {change}."
    return Reason(text, row.ended or row.begin, ReasonKind.ATTEMPT, ids)


def _departure(story: EdgeStory, believing: Believing | None) -> Reason:
    life, ids = story.lives[-1], (story.source, story.target)
    assert life.end is not None  # Only edges that are gone come here.
    last = life.history[-1]
    if life.end.attempt is not None:
        below = f", below R_p = {believing.prune_below:.2f}," if believing else ""
        failures = counted(last.attempts - last.successes, "failure")
        text = f"It was pruned after attempt {life.end.attempt}: p = {last.belief.p:.2f}{below} with {failures}."
    elif life.end.node is not None:
        text = f"It went with node {life.end.node}, which left {CAUSES[life.end.cause]}."
        ids = (*ids, life.end.node)
    elif life.end.whole_map:
        text = f"It went with its map when another one came in {CAUSES[life.end.cause]}."
    else:
        text = f"It was pruned {CAUSES[life.end.cause]}."
    return Reason(text, life.end.instant, ReasonKind.GONE, ids)
