"""Progress of a navigation task after some events: its goal, plan and attempt, and counts over the run.

`apply_event` is a pure function, so that the same code tells it live, in a replay, and at any moment between. Owns no
map.
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
    """How the navigation stands after some events."""

    navigator: e.NavigatorState = e.NavigatorState.IDLE
    query: int | None = None
    """The task in progress; None when none is."""
    goal: NodeId | None = None
    plan: tuple[NodeId, ...] = ()
    attempt: e.AttemptStarted | None = None
    """The edge being driven."""
    action: e.ActionBegun | None = None
    """The action that the robot waits for."""
    localised: e.Localised | None = None
    """The latest comparison with the map."""
    ended: e.QueryEnded | None = None
    """How the latest task ended."""
    judged: e.Judged | None = None
    """In simulation, whether that was true."""
    note: e.Note | None = None
    """The latest thing to read."""
    failures: Mapping[EdgeKey, int] = MappingProxyType({})
    """Number of failures of each edge in the latest task."""
    queries: int = 0
    reached: int = 0
    """Tasks that ended with the robot judging itself at the goal."""
    collisions: int = 0
    pruned: int = 0
    """Edges that were pruned since the map was built or opened."""
    added: int = 0
    """Edges that were added since then, one by one, while driving or navigating or by hand."""
    blocked: frozenset[EdgeKey] = frozenset()
    """Edges of the map that were seen blocked when they were seen last; what left the map is forgotten with it."""
    seen_blocked: int = 0
    """Number of observations of blocked edges, including those that came with the map."""
    obstructions: int = 0
    """Number of obstructions in the latest task."""
    obstructed_s: float | None = None
    """Time of the latest obstruction on the clock of the world, in seconds."""
    world: WorldState = AS_MADE
    """In simulation, what the world is like."""


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
    # One obstruction blocks several edges at one moment.
    if event.query is None or seen.stamp == progress.obstructed_s:
        return looked
    return looked._replace(obstructions=progress.obstructions + 1, obstructed_s=seen.stamp)
