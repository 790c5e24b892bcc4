"""Progress of navigation after some events: goal, plan and attempt, and counts over the run.

`apply_event` is a pure function, so that the same code serves live runs, replays, and any moment between. Holds no map.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, assert_never

from ltvn_core.analysis.timeline_records import edges_between
from ltvn_core.graph import deltas
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId
from ltvn_core.worlds import AS_MADE, WorldState


class NavigationProgress(NamedTuple):
    """The state of navigation after some events."""

    navigator: e.NavigatorState = e.NavigatorState.IDLE
    query: int | None = None
    """The query in progress; None if there is none."""
    goal: NodeId | None = None
    plan: tuple[NodeId, ...] = ()
    attempt: e.AttemptStarted | None = None
    """The attempt in progress; None if there is none."""
    action: e.ActionBegun | None = None
    """The action that the robot waits for; None if there is none."""
    localised: e.Localised | None = None
    """The latest localisation."""
    ended: e.QueryEnded | None = None
    """The end of the latest query; None if it has not ended."""
    judged: e.Judged | None = None
    """In simulation, the verdict on the latest query by the ground truth."""
    note: e.Note | None = None
    """The latest note of the robot."""
    failures: Mapping[EdgeKey, int] = MappingProxyType({})
    """Number of failures of each edge in the latest query."""
    queries: int = 0
    reached: int = 0
    """Number of queries in which the robot declared arrival."""
    collisions: int = 0
    pruned: int = 0
    """Number of edges that were pruned since the map was built or opened."""
    added: int = 0
    """Number of edges that were added since the map was built or opened."""
    blocked: frozenset[EdgeKey] = frozenset()
    """Edges of the map whose last observation showed them blocked."""
    seen_blocked: int = 0
    """Number of observations of blocked edges, including those that came with the map."""
    obstructions: int = 0
    """Number of obstructions in the latest query."""
    obstructed_s: float | None = None
    """Time of the latest obstruction, in seconds of the world."""
    world: WorldState = AS_MADE
    """In simulation, the state of the world."""


NO_PROGRESS = NavigationProgress()


def apply_event(progress: NavigationProgress, event: e.Event) -> NavigationProgress:
    """Return the progress after `event`."""
    match event:
        case e.StateChanged(state):
            return progress._replace(navigator=state)
        case e.QueryStarted(query, goal):
            fresh = progress._replace(query=query, goal=goal, plan=(), attempt=None, action=None, localised=None)
            fresh = fresh._replace(obstructions=0, obstructed_s=None)
            return fresh._replace(ended=None, judged=None, failures={}, queries=progress.queries + 1)
        case e.Localised():
            return progress._replace(localised=event)
        case e.Planned(_, nodes, _):
            return progress._replace(plan=nodes)
        case e.AttemptStarted():
            return progress._replace(attempt=event)
        case e.AttemptEnded():
            return progress._replace(attempt=None, failures=_failures(progress, event))
        case e.ActionBegun():
            return progress._replace(action=event)
        case e.ActionEnded():
            return progress._replace(action=None)
        case e.Collided():
            return progress._replace(collisions=progress.collisions + 1)
        case e.QueryEnded():
            return _after_end(progress, event)
        case e.Judged():
            return progress._replace(judged=event)
        case e.Note():
            return progress._replace(note=event)
        case e.GraphChanged():
            return _after_change(progress, event)
        case e.WorldChanged(change):
            return progress._replace(world=progress.world.after(change))
    assert_never(event)


def _failures(progress: NavigationProgress, event: e.AttemptEnded) -> Mapping[EdgeKey, int]:
    if event.succeeded or event.source is None:
        return progress.failures
    driven = edges_between(progress.plan, event.source, event.target)
    return {**progress.failures, **{edge: progress.failures.get(edge, 0) + 1 for edge in driven}}


def _after_end(progress: NavigationProgress, event: e.QueryEnded) -> NavigationProgress:
    arrived = event.outcome is e.Outcome.ARRIVED
    return progress._replace(
        navigator=e.NavigatorState.IDLE,
        query=None,
        plan=(),
        attempt=None,
        action=None,
        ended=event,
        reached=progress.reached + arrived,
    )


def _after_change(progress: NavigationProgress, event: e.GraphChanged) -> NavigationProgress:
    if isinstance(event.delta, deltas.PresenceObserved):
        return _after_look(progress, event, event.delta)
    if progress.blocked:
        progress = progress._replace(blocked=_still_there(progress.blocked, event.delta))
    if event.delta.cause in deltas.BULK_CAUSES:
        return progress._replace(pruned=0, added=0)
    if isinstance(event.delta, deltas.EdgePruned):
        return progress._replace(pruned=progress.pruned + 1)
    if isinstance(event.delta, deltas.EdgeAdded):
        return progress._replace(added=progress.added + 1)
    return progress


def _still_there(blocked: frozenset[EdgeKey], delta: deltas.GraphDelta) -> frozenset[EdgeKey]:
    match delta:
        case deltas.EdgePruned(source, target):
            return blocked - {(source, target)}
        case deltas.NodeDropped(node):
            return frozenset(edge for edge in blocked if node not in edge)
        case _:
            return blocked


def _after_look(
    progress: NavigationProgress, event: e.GraphChanged, seen: deltas.PresenceObserved
) -> NavigationProgress:
    edge = {(seen.source, seen.target)}
    if seen.present:
        return progress._replace(blocked=progress.blocked - edge)
    looked = progress._replace(blocked=progress.blocked | edge, seen_blocked=progress.seen_blocked + 1)
    # One obstruction can block several edges at the same moment.
    if event.query is None or seen.stamp == progress.obstructed_s:
        return looked
    return looked._replace(obstructions=progress.obstructions + 1, obstructed_s=seen.stamp)
