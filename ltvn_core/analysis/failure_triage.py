"""The failed queries of a run: cause, place, and the moment at which each began to go wrong, as known to the robot.

Owns the failure modes and the search for setbacks within a query. The robot has recovered from a setback as soon as a
plan is cheaper than all plans before the setback. A successful attempt is not enough: a robot that is stuck drives to
and fro, and half of its attempts succeed. Uses no ground truth; `ltvn_core.evaluation` finds the true cause of a
failure.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import hypot, inf
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, QueryRecord
from ltvn_core.graph.deltas import NodeAdded, PoseRow
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.event_text import describe_event
from ltvn_core.navigation.events import (
    ActionEnded,
    AttemptEnd,
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    GraphChanged,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
    Severity,
)
from ltvn_core.types import NodeId

_NEARER = 0.2
"""Least reduction of the plan's cost that counts as progress; a smaller one may come from new beliefs alone (ours)."""
_BEFORE_S = 1.0
_STEPS_PER_S = 10.0
"""Control steps per second, for a query that is too short to measure them."""


class Setback(NamedTuple):
    """An event in which something went wrong."""

    event: int
    """Index in the timeline's events."""
    text: str
    edge: EdgeKey | None
    """The edge that was being driven; None if there was none."""
    node: NodeId | None
    """Last node at which the robot was localised; None if there is none."""


class _SetbackTracker:
    """Finds the setbacks of a query, event by event."""

    def __init__(self) -> None:
        self.collisions: list[Setback] = []
        self.setback: Setback | None = None
        """The first setback from which the robot has not recovered so far."""
        self._cheapest = inf
        self._cheapest_before = inf
        self._node: NodeId | None = None
        self._edge: EdgeKey | None = None

    def take(self, index: int, event: Event) -> None:
        if isinstance(event, GraphChanged):
            return  # A change of the map is only the consequence of a setback.
        if isinstance(event, Localised):
            self._node = self._node if event.node is None else event.node
            self._edge = None
        elif isinstance(event, AttemptStarted):
            self._edge = None if event.source is None else (event.source, event.target)
        elif isinstance(event, Planned) and event.nodes:
            self._nearer(event.cost)
        description = describe_event(event)
        if description.severity is Severity.INFO:
            return
        setback = Setback(event=index, text=description.sentence, edge=self._edge, node=self._node)
        if isinstance(event, Collided):
            self.collisions.append(setback)
        if self.setback is None:
            self.setback = setback
            self._cheapest_before = self._cheapest

    def _nearer(self, cost: float) -> None:
        if self.setback is not None and cost < self._cheapest_before - _NEARER:
            self.setback = None
        self._cheapest = min(self._cheapest, cost)


def first_setback(timeline: Timeline, query: QueryRecord) -> Setback | None:
    """Return the first setback from which a query never recovered, None if there is none; linear in its events."""
    return _tracked(timeline, query).setback


def worst_collision(timeline: Timeline, query: QueryRecord) -> Setback | None:
    """Return the first collision at the node with the most collisions of a query; None without collisions.

    Collisions are counted even if the robot recovered from them. Linear in the events of the query.
    """
    collisions = _tracked(timeline, query).collisions
    counts = Counter(collision.node for collision in collisions)
    return max(collisions, key=lambda collision: counts[collision.node], default=None)


def _tracked(timeline: Timeline, query: QueryRecord) -> _SetbackTracker:
    watch = _SetbackTracker()
    for index in range(query.first, query.last + 1):
        watch.take(index, timeline.events[index].event)
    return watch


class FailureMode(StrEnum):
    """What made a query fail, by the event at which it began to go wrong."""

    ODOMETRY = "odometry"
    """By odometry the robot got to the end of an edge, but the image there shows another place."""
    FALSE_EDGE = "false edge"
    """An edge could not be driven in its steps though nothing was in the way, or it led to a place that was taken for
    the goal."""
    OBSTRUCTED = "obstructed"
    """Something was in the way, or an action that opens the way failed."""
    NOT_RECOGNISED = "not recognised"
    """The images showed neither where the robot was nor a way to the goal."""


def _failure_mode(event: Event) -> FailureMode:
    match event:
        case Collided() | ActionEnded() | AttemptEnded(end=AttemptEnd.COLLISION | AttemptEnd.BLOCKED):
            return FailureMode.OBSTRUCTED
        case QueryEnded(outcome=Outcome.COLLISION_LIMIT):
            return FailureMode.OBSTRUCTED
        case AttemptEnded(end=AttemptEnd.REACHED):
            return FailureMode.ODOMETRY
        case AttemptEnded(end=AttemptEnd.TIMEOUT) | QueryEnded(outcome=Outcome.ARRIVED):
            return FailureMode.FALSE_EDGE
        case _:
            return FailureMode.NOT_RECOGNISED


@dataclass(frozen=True, slots=True)
class FailedQuery:
    """A failed query, and the moment and place at which it failed."""

    query: QueryRecord
    failure_mode: FailureMode
    instant: Instant
    """One second before the setback."""
    event: int
    """Index of the setback in the timeline's events."""
    text: str
    """The setback as a sentence."""
    edge: EdgeKey | None
    """The edge that was being driven; None if there was none."""
    node: NodeId | None
    """Last node at which the robot was localised; None if there is none."""
    pose: PoseRow | None
    """Pose of that node by odometry."""

    @property
    def ending(self) -> str:
        """How the query ended: the word of its own outcome, or an arrival that the evaluation calls wrong."""
        return "wrong arrival" if self.query.outcome is Outcome.ARRIVED else str(self.query.outcome)


@dataclass(frozen=True, slots=True)
class FailureCluster:
    """Failures whose setbacks are near each other."""

    nodes: tuple[NodeId, ...]
    """Nodes of the setbacks; empty if the robot was never localised."""
    pose: PoseRow | None
    """Pose of the first failure's node, by odometry."""
    failures: tuple[FailedQuery, ...]


def failed_queries(timeline: Timeline) -> tuple[FailedQuery, ...]:
    """Return all failed queries in order, without cut and cancelled ones. Linear in the events."""
    return tuple(_failed(timeline, query) for query in timeline.queries if query.succeeded is False)


def group_by_failure_mode(failures: Iterable[FailedQuery]) -> Mapping[FailureMode, tuple[FailedQuery, ...]]:
    """Group failures by mode, the most frequent mode first."""
    groups: dict[FailureMode, list[FailedQuery]] = {}
    for failure in failures:
        groups.setdefault(failure.failure_mode, []).append(failure)
    return {
        failure_mode: tuple(group) for failure_mode, group in sorted(groups.items(), key=lambda item: -len(item[1]))
    }


def group_by_place(failures: Iterable[FailedQuery], *, radius_m: float = 1.0) -> tuple[FailureCluster, ...]:
    """Group failures by place, the place with most failures first; a place extends `radius_m` around its first failure.

    Takes time proportional to failures times places.
    """
    groups: list[list[FailedQuery]] = []
    for failure in failures:
        near = (group for group in groups if _same_place(group[0], failure, radius_m))
        group = next(near, None)
        if group is None:
            groups.append([failure])
        else:
            group.append(failure)
    return tuple(_place(group) for group in sorted(groups, key=lambda group: -len(group)))


def _failed(timeline: Timeline, query: QueryRecord) -> FailedQuery:
    setback = _setback(timeline, query) or Setback(
        event=query.last, text=_ending(query), edge=None, node=_last_node(timeline, query)
    )
    return FailedQuery(
        query=query,
        failure_mode=_failure_mode(timeline.events[setback.event].event),
        instant=_second_before(timeline, query, setback.event),
        event=setback.event,
        text=setback.text,
        edge=setback.edge,
        node=setback.node,
        pose=_pose_of(timeline, query, setback.node),
    )


def _setback(timeline: Timeline, query: QueryRecord) -> Setback | None:
    if query.outcome is Outcome.ARRIVED:
        return None  # The robot was sure that it had arrived.
    worst = worst_collision(timeline, query) if query.outcome is Outcome.COLLISION_LIMIT else None
    return worst or first_setback(timeline, query)


def _ending(query: QueryRecord) -> str:
    off = f", {query.judged.position_error_m:.2f} m from the goal" if query.judged else ""
    return f"The query ended: {query.outcome}{off}."


def _last_node(timeline: Timeline, query: QueryRecord) -> NodeId | None:
    events = reversed(timeline.events[query.first : query.last + 1])
    looks = (stamped.event for stamped in events if isinstance(stamped.event, Localised))
    return next((look.node for look in looks if look.node is not None), None)


def _second_before(timeline: Timeline, query: QueryRecord, event: int) -> Instant:
    """Return the instant one second before an event, or the beginning of the query if that is later."""
    begin = query.begin
    then = timeline.instant(event)
    seconds = then.stamp - begin.stamp
    rate = (then.step - begin.step) / seconds if seconds > 0 else _STEPS_PER_S
    step = then.step - round(rate * _BEFORE_S)
    return max(begin, Instant(step, then.stamp - _BEFORE_S))


def _pose_of(timeline: Timeline, query: QueryRecord, node: NodeId | None) -> PoseRow | None:
    came = () if node is None else timeline.changes_of_node(node)
    poses = [
        change.delta.node.odometry
        for change in came
        if isinstance(change.delta, NodeAdded) and change.epoch == query.epoch
    ]
    return poses[-1] if poses else None


def _same_place(first: FailedQuery, other: FailedQuery, radius_m: float) -> bool:
    if first.pose is None or other.pose is None or first.query.epoch != other.query.epoch:
        return (first.node, first.query.epoch) == (other.node, other.query.epoch)
    return hypot(first.pose.x_m - other.pose.x_m, first.pose.y_m - other.pose.y_m) <= radius_m


def _place(group: list[FailedQuery]) -> FailureCluster:
    nodes = dict.fromkeys(failure.node for failure in group if failure.node is not None)
    return FailureCluster(tuple(nodes), group[0].pose, tuple(group))
