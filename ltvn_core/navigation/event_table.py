"""The one table of all events and changes of the map: words, severity, mark on the timeline, and what each changes.

A new event needs its class in `navigation.events` and a `case` here; pyright and a test fail until it has one. The
Rerun log, the timeline and the debugger show the words; the exact event is stored beside them, so nothing parses the
text. The page owns the look of a mark.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple, assert_never

from ltvn_core.findings import Severity
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId
from ltvn_core.worlds import AS_MADE, DoorMoved, PersonLeft, PersonMoved, WorldChange, WorldState, change_text


class NavigationProgress(NamedTuple):
    """The state of navigation after some events."""

    navigator: e.NavigatorState = e.NavigatorState.IDLE
    query: int | None = None
    """The query in progress; None if there is none."""
    goal: NodeId | None = None
    plan: tuple[NodeId, ...] = ()
    last_plan: tuple[NodeId, ...] | None = None
    """The latest path of the latest query, also after its end; None before its first."""
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


def edges_between(path: Sequence[NodeId], source: NodeId, target: NodeId) -> tuple[EdgeKey, ...]:
    """Return the edges of a path between two of its nodes, or the direct edge if the path does not contain both in
    order.

    An attempt to a subgoal farther ahead drives all of these edges, and its failure counts against each.
    """
    if source in path and target in path[path.index(source) + 1 :]:
        return tuple(itertools.pairwise(path[path.index(source) : path.index(target) + 1]))
    return ((source, target),)


_MAX_NODES = 8
"""Number of nodes above which a path is described by its first and last nodes."""
_ARRIVED_BY = {e.BY_IMAGE: " by its image", e.BY_PLACE: " by the images around", e.BY_WAYPOINT: " by its waypoint"}
"""Rule of an arrival -> what showed it."""
_EXPANSION_CAUSES = (d.Cause.EXPAND, d.Cause.NOVEL)


class MarkKind(StrEnum):
    """Kind of a mark on the timeline."""

    MAP = "map"
    """A whole map was built or loaded."""
    QUERY_START = "query start"
    QUERY_END = "query end"
    PRUNE = "prune"
    """An edge was removed from the map, or a person removed a node."""
    EXPAND = "expand"
    """A node was added because the robot was lost or found no path."""
    COLLISION = "collision"
    FAILURE = "failure"
    """An attempt did not succeed."""
    REPLAN = "replan"
    """The plan is not the rest of the previous one."""
    ADD = "add"
    """A node or an edge was added for another reason, not with a whole map."""
    SEEN_OPEN = "seen open"
    SEEN_BLOCKED = "seen blocked"
    DOOR_OPENED = "door opened"
    DOOR_CLOSED = "door closed"
    WORLD = "world"
    """A thing was put down or taken away, or the light changed."""


class EventDescription(NamedTuple):
    """The row of an event or a change of the map."""

    words: Callable[[], str]
    """Makes the text, which is needed only when it is shown."""
    severity: Severity = Severity.INFO
    about: tuple[int, ...] = ()
    """The nodes, the two nodes of an edge, or the number of a door; empty for anything else."""
    mark: MarkKind | None = None
    """The mark on the timeline; None without one."""
    after: NavigationProgress = NO_PROGRESS
    """The progress after the event."""

    @property
    def text(self) -> str:
        """One line without a full stop; it begins with a lower-case letter unless a person wrote it."""
        return self.words()

    @property
    def sentence(self) -> str:
        """The line as a sentence."""
        text = self.text
        return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def describe_event(event: e.Event, before: NavigationProgress = NO_PROGRESS) -> EventDescription:
    """Return the row of an event.

    Args:
        event: What happened.
        before: The progress just before; only mark and progress depend on it.
    """
    row = EventDescription
    match event:
        case e.GraphChanged(delta):  # First, because it is by far the most frequent event.
            words, severity, about, mark, _ = describe_delta(delta)
            mark = None if delta.cause in d.BULK_CAUSES else mark
            return row(words, severity, about, mark, _after_change(event, before))
        case e.StateChanged(state):
            return row(lambda: f"now {state}", after=before._replace(navigator=state))
        case e.QueryStarted(query, goal):
            text = f"query {query} started: node {goal} is the goal"
            return row(lambda: text, about=(goal,), mark=MarkKind.QUERY_START, after=_after_start(event, before))
        case e.Localised(node=node):
            return row(lambda: _localised(event), _warn(node is None), after=before._replace(localised=event))
        case e.Planned(nodes=nodes):
            ends = (*nodes[:1], *nodes[-1:])
            mark = MarkKind.REPLAN if _is_other_plan(nodes, before.last_plan) else None
            after = before._replace(plan=nodes, last_plan=nodes)
            return row(lambda: _planned(event), _warn(not nodes), ends, mark, after)
        case e.AttemptStarted(reachability=r):
            after = before._replace(attempt=event)
            return row(lambda: f"{_attempt(event)} started, reachability {r:.2f}", about=_driven(event), after=after)
        case e.AttemptEnded(end=end, succeeded=succeeded):
            text = f"{_attempt(event)} {f'succeeded ({end})' if succeeded else end.failure}{_reason(event)}"
            mark = None if succeeded or end is e.AttemptEnd.CANCELLED else MarkKind.FAILURE
            return row(lambda: text, _warn(not succeeded), _driven(event), mark, _after_attempt(event, before))
        case e.ActionBegun(_, source, target, _, action):
            text = f"action of {edge_text((source, target))} begun: {action}"
            return row(lambda: text, about=(source, target), after=before._replace(action=event))
        case e.ActionEnded(_, source, target, _, succeeded):
            text = f"action of {edge_text((source, target))} {'done' if succeeded else 'failed'}{_reason(event)}"
            mark = None if succeeded else MarkKind.FAILURE
            return row(lambda: text, _warn(not succeeded), (source, target), mark, before._replace(action=None))
        case e.Collided(query, count):
            after = before._replace(collisions=before.collisions + 1)
            return row(lambda: f"collision {count} of query {query}", Severity.WARN, (), MarkKind.COLLISION, after)
        case e.QueryEnded(goal=goal):
            return row(lambda: _ended(event), Severity.INFO, (goal,), MarkKind.QUERY_END, _after_end(event, before))
        case e.Judged(reached=reached):
            severity = Severity.INFO if reached else Severity.ERROR
            return row(lambda: _judged(event), severity, after=before._replace(judged=event))
        case e.Note(text, severity):
            return row(lambda: text, severity, after=before._replace(note=event))
        case e.WorldChanged(change):
            door = (change.door,) if isinstance(change, DoorMoved) else ()
            after = before._replace(world=before.world.after(change))
            return row(lambda: f"world: {change_text(change)}", Severity.INFO, door, _world_mark(change), after)
    assert_never(event)


def describe_delta(delta: d.GraphDelta) -> EventDescription:
    """Return the row of a change of the map, with its cause in brackets; it says nothing about the progress."""
    row = EventDescription
    match delta:
        case d.NodeAdded(node, cause):
            mark = MarkKind.EXPAND if cause in _EXPANSION_CAUSES else MarkKind.ADD
            return row(lambda: f"node {node.id} added ({cause})", about=(node.id,), mark=mark)
        case d.NodeDropped(node, cause):
            return row(lambda: f"node {node} dropped ({cause})", Severity.WARN, (node,), MarkKind.PRUNE)
        case d.EdgeAdded(edge, cause):
            ends = edge.source, edge.target
            origin = " by odometry" if edge.by_odometry else ""
            return row(
                lambda: f"{edge_text(ends)} added{origin}, p {edge.belief.p:.2f} ({cause})",
                about=ends,
                mark=MarkKind.ADD,
            )
        case d.BeliefUpdated(source, target, belief, attempts, successes, cause):
            ends = source, target
            return row(
                lambda: (
                    f"{edge_text(ends)} has p {belief.p:.2f}, {successes} of {count_text(attempts, 'attempt')} "
                    f"succeeded ({cause})"
                ),
                about=ends,
            )
        case d.EdgePruned(source, target, cause):
            ends = source, target
            return row(lambda: f"{edge_text(ends)} pruned ({cause})", Severity.WARN, ends, MarkKind.PRUNE)
        case d.EdgeProtected(source, target, protected, cause):
            ends = source, target
            words = "protected" if protected else "no longer protected"
            return row(lambda: f"{edge_text(ends)} {words} ({cause})", about=ends)
        case d.EdgeActionSet(source, target, action, cause):
            ends = source, target
            words = f"needs the action {action!r}" if action else "is driven, without an action"
            return row(lambda: f"{edge_text(ends)} {words} ({cause})", about=ends)
        case d.PresenceObserved(source, target, present, _, cause):
            ends = source, target
            words, mark = ("open", MarkKind.SEEN_OPEN) if present else ("blocked", MarkKind.SEEN_BLOCKED)
            return row(lambda: f"{edge_text(ends)} seen {words} ({cause})", _warn(not present), ends, mark)
        case d.NodeNamed(node, name, goal, cause):
            named = f"{f'named {name!r}' if name else 'without a name'}{', a goal' if goal else ''}"
            return row(lambda: f"node {node} {named} ({cause})", about=(node,))
        case d.DriveBegun(frame, name, cause):
            return row(lambda: f"images from {frame} on are of the drive {name!r} ({cause})")
        case d.FramesReserved(frames, cause):
            return row(lambda: f"{count_text(len(frames), 'image')} joined the reserve ({cause})")
        case d.FramesReleased(frames, cause):
            return row(lambda: f"{count_text(len(frames), 'image')} left the reserve ({cause})")
    assert_never(delta)


def edge_text(edge: EdgeKey) -> str:
    """Return the name of an edge."""
    return f"edge {edge[0]} → {edge[1]}"


def _warn(is_bad: bool) -> Severity:
    return Severity.WARN if is_bad else Severity.INFO


def _driven(event: e.AttemptStarted | e.AttemptEnded) -> tuple[NodeId, ...]:
    return (event.target,) if event.source is None else (event.source, event.target)


def _attempt(event: e.AttemptStarted | e.AttemptEnded) -> str:
    way = f"to node {event.target}" if event.source is None else f"along {edge_text((event.source, event.target))}"
    return f"attempt {event.attempt} {way}"


def _reason(event: e.AttemptEnded | e.ActionEnded) -> str:
    return f": {event.reason}" if event.reason else ""


def _localised(event: e.Localised) -> str:
    if event.node is None:
        away = f"the best node is {event.distance:.2f} away" if math.isfinite(event.distance) else "the map is empty"
        return f"lost: {away} ({event.scope})"
    second = "" if event.runner_up is None else f", margin {event.margin:.2f} to node {event.runner_up}"
    sure = "" if event.probability is None else f", place probability {event.probability:.0%}"
    numbers = f"distance {event.distance:.2f}, reachability {event.reachability:.2f}{second}{sure}"
    return f"at node {event.node}: {numbers} ({event.scope})"


def _planned(event: e.Planned) -> str:
    if not event.nodes:
        return "no path to the goal"
    shown = [*map(str, event.nodes)]
    path = " → ".join(shown if len(shown) <= _MAX_NODES else [*shown[: _MAX_NODES - 2], "...", shown[-1]])
    return f"plan of {count_text(len(event.nodes), 'node')}, cost {event.cost:.2f}: {path}"


def _is_other_plan(nodes: tuple[NodeId, ...], last_plan: tuple[NodeId, ...] | None) -> bool:
    """Tell whether a path differs from the rest of the previous path; no path also counts as different."""
    if last_plan is None or nodes == last_plan:
        return False
    return not nodes or nodes != last_plan[-len(nodes) :]


def _ended(event: e.QueryEnded) -> str:
    driven = f"{count_text(event.steps, 'step')}, {event.path_m:.1f} m, {count_text(event.collisions, 'collision')}"
    return f"query {event.query} ended: {event.outcome}{_ARRIVED_BY.get(event.rule, '')} after {driven}"


def _judged(event: e.Judged) -> str:
    away = f"{event.position_error_m:.2f} m and {event.yaw_error_rad:.2f} rad away"
    return f"query {event.query} judged: goal {'reached' if event.reached else 'missed'}, {away}"


def _world_mark(change: WorldChange) -> MarkKind | None:
    if isinstance(change, DoorMoved):
        return MarkKind.DOOR_OPENED if change.is_open else MarkKind.DOOR_CLOSED
    return None if isinstance(change, PersonMoved | PersonLeft) else MarkKind.WORLD


def _after_start(event: e.QueryStarted, before: NavigationProgress) -> NavigationProgress:
    fresh = before._replace(query=event.query, goal=event.goal, plan=(), last_plan=None, attempt=None, action=None)
    fresh = fresh._replace(localised=None, ended=None, judged=None, failures={}, obstructions=0, obstructed_s=None)
    return fresh._replace(queries=before.queries + 1)


def _after_attempt(event: e.AttemptEnded, before: NavigationProgress) -> NavigationProgress:
    if event.succeeded or event.source is None:
        return before._replace(attempt=None)
    driven = edges_between(before.plan, event.source, event.target)
    failures = {**before.failures, **{edge: before.failures.get(edge, 0) + 1 for edge in driven}}
    return before._replace(attempt=None, failures=failures)


def _after_end(event: e.QueryEnded, before: NavigationProgress) -> NavigationProgress:
    reached = before.reached + (event.outcome is e.Outcome.ARRIVED)
    idle = before._replace(navigator=e.NavigatorState.IDLE, query=None, plan=(), attempt=None, action=None)
    return idle._replace(ended=event, reached=reached)


def _after_change(event: e.GraphChanged, before: NavigationProgress) -> NavigationProgress:
    delta = event.delta
    if isinstance(delta, d.PresenceObserved):
        return _after_look(delta, before, in_query=event.query is not None)
    if before.blocked and isinstance(delta, d.EdgePruned):
        before = before._replace(blocked=before.blocked - {(delta.source, delta.target)})
    elif before.blocked and isinstance(delta, d.NodeDropped):
        before = before._replace(blocked=frozenset(edge for edge in before.blocked if delta.node not in edge))
    if delta.cause in d.BULK_CAUSES:
        return before._replace(pruned=0, added=0) if before.pruned or before.added else before
    if isinstance(delta, d.EdgePruned):
        return before._replace(pruned=before.pruned + 1)
    return before._replace(added=before.added + 1) if isinstance(delta, d.EdgeAdded) else before


def _after_look(seen: d.PresenceObserved, before: NavigationProgress, *, in_query: bool) -> NavigationProgress:
    edge = {(seen.source, seen.target)}
    if seen.present:
        return before._replace(blocked=before.blocked - edge)
    looked = before._replace(blocked=before.blocked | edge, seen_blocked=before.seen_blocked + 1)
    # One obstruction can block several edges at the same moment.
    if not in_query or seen.stamp == before.obstructed_s:
        return looked
    return looked._replace(obstructions=before.obstructions + 1, obstructed_s=seen.stamp)
