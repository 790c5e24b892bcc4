"""Where a navigation task stands, folded from events.

`after(progress, event)` is a pure reducer, so the same code says how things stand live, in a replay, and at any moment
between. Owns no graph: that is `history.GraphHistory`.
"""

from dataclasses import dataclass, replace

from ltvn_core.graph import deltas
from ltvn_core.nav import events as e
from ltvn_core.types import NodeId


@dataclass(frozen=True, slots=True)
class Progress:
    """How the navigation stands after some events."""

    navigator: e.NavigatorState = e.NavigatorState.IDLE
    query: int | None = None
    """The task under way; None when none is."""
    goal: NodeId | None = None
    plan: tuple[NodeId, ...] = ()
    plan_cost: float = 0.0
    leg: e.LegStarted | None = None
    """The edge being driven."""
    localised: e.Localised | None = None
    """The latest comparison with the map."""
    ended: e.QueryEnded | None = None
    """How the latest task ended."""
    judged: e.Judged | None = None
    """In simulation, whether that was true."""
    note: e.Note | None = None
    """The latest thing to read."""
    queries: int = 0
    reached: int = 0
    """Tasks that ended with the robot judging itself at the goal."""
    collisions: int = 0
    pruned: int = 0
    added: int = 0
    """Edges that navigation added."""


def after(progress: Progress, event: e.Event) -> Progress:
    """Return how things stand once `event` has happened."""
    match event:
        case e.StateChanged(state):
            return replace(progress, navigator=state)
        case e.QueryStarted(query, goal):
            fresh = replace(progress, query=query, goal=goal, plan=(), leg=None, localised=None)
            return replace(fresh, ended=None, judged=None, queries=progress.queries + 1)
        case e.Localised():
            return replace(progress, localised=event)
        case e.Planned(_, nodes, cost):
            return replace(progress, plan=nodes, plan_cost=cost)
        case e.LegStarted():
            return replace(progress, leg=event)
        case e.LegEnded():
            return replace(progress, leg=None)
        case e.Collided():
            return replace(progress, collisions=progress.collisions + 1)
        case e.QueryEnded():
            return _after_end(progress, event)
        case e.Judged():
            return replace(progress, judged=event)
        case e.Note():
            return replace(progress, note=event)
        case e.GraphChanged():
            return _after_change(progress, event)
    return progress


def _after_end(progress: Progress, event: e.QueryEnded) -> Progress:
    arrived = event.outcome is e.Outcome.ARRIVED
    return replace(
        progress,
        navigator=e.NavigatorState.IDLE,
        query=None,
        plan=(),
        leg=None,
        ended=event,
        reached=progress.reached + arrived,
    )


def _after_change(progress: Progress, event: e.GraphChanged) -> Progress:
    if isinstance(event.delta, deltas.EdgePruned):
        return replace(progress, pruned=progress.pruned + 1)
    if isinstance(event.delta, deltas.EdgeAdded) and event.query is not None:
        return replace(progress, added=progress.added + 1)
    return progress
