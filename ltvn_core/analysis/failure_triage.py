"""The failed queries of a run: cause, place, and the moment at which each began to go wrong, as known to the robot.

Owns the failure modes and the search for setbacks within a query. The robot has recovered from a setback as soon as a
plan is cheaper than all plans before the setback. A successful attempt is not enough: a robot that is stuck drives to
and fro, and half of its attempts succeed. Uses no ground truth; `ltvn_core.evaluation` finds the true cause of a
failure.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from math import hypot, inf

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, QueryRecord
from ltvn_core.graph.deltas import NodeAdded, PoseRow
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.event_table import describe_event
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


@dataclass(frozen=True, slots=True)
class Setback:
    """An event in which something went wrong."""

    event: int
    """Index in the timeline's events."""
    text: str
    """What went wrong, as a sentence."""
    edge: EdgeKey | None
    """The edge that was being driven; None if there was none."""
    node: NodeId | None
    """Last node at which the robot was localised; None if there is none."""


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
class FailedQuery(Setback):
    """A failed query, and the setback from which it did not recover."""

    query: QueryRecord
    failure_mode: FailureMode
    instant: Instant
    """One second before the setback."""
    pose: PoseRow | None
    """Pose of `node` by odometry."""

    @property
    def ending(self) -> str:
        """How the query ended: the word of its own outcome, or an arrival that the evaluation calls wrong."""
        return "wrong arrival" if self.query.outcome is Outcome.ARRIVED else str(self.query.outcome)


def failed_queries(timeline: Timeline) -> tuple[FailedQuery, ...]:
    """Return all failed queries in order, without cut and cancelled ones. Linear in the events."""
    return tuple(failed_query(timeline, query) for query in timeline.queries if query.succeeded is False)


def group_by_failure_mode(failures: Iterable[FailedQuery]) -> Mapping[FailureMode, tuple[FailedQuery, ...]]:
    """Group failures by mode, the most frequent mode first."""
    groups: dict[FailureMode, list[FailedQuery]] = {}
    for failure in failures:
        groups.setdefault(failure.failure_mode, []).append(failure)
    return {mode: tuple(group) for mode, group in sorted(groups.items(), key=lambda item: -len(item[1]))}


def group_by_place(failures: Iterable[FailedQuery], *, radius_m: float = 1.0) -> tuple[tuple[FailedQuery, ...], ...]:
    """Group failures by place, the place with most failures first; a place extends `radius_m` around its first failure.

    Takes time proportional to failures times places.
    """
    groups: list[list[FailedQuery]] = []
    for failure in failures:
        near = next((group for group in groups if _same_place(group[0], failure, radius_m)), None)
        if near is None:
            groups.append([failure])
        else:
            near.append(failure)
    return tuple(tuple(group) for group in sorted(groups, key=lambda group: -len(group)))


def failed_query(timeline: Timeline, query: QueryRecord) -> FailedQuery:
    """Return when, where and why a query failed. Linear in its events."""
    setback = _setback(timeline, query)
    came = () if setback.node is None else timeline.changes_of_node(setback.node)
    poses = [
        change.delta.node.odometry
        for change in came
        if isinstance(change.delta, NodeAdded) and change.epoch == query.epoch
    ]
    begin, then = query.begin, timeline.instant(setback.event)
    seconds = then.stamp - begin.stamp
    rate = (then.step - begin.step) / seconds if seconds > 0 else _STEPS_PER_S
    second_before = Instant(then.step - round(rate * _BEFORE_S), then.stamp - _BEFORE_S)
    return FailedQuery(
        query=query,
        failure_mode=_failure_mode(timeline.events[setback.event].event),
        instant=max(begin, second_before),
        pose=poses[-1] if poses else None,
        **asdict(setback),
    )


def _setback(timeline: Timeline, query: QueryRecord) -> Setback:
    """Return the first event of a query in which something went wrong and from which the robot did not recover."""
    setback: Setback | None = None
    collisions: list[Setback] = []
    node: NodeId | None = None
    edge: EdgeKey | None = None
    cheapest = cheapest_before = inf
    for index in range(query.first, query.last + 1):
        event = timeline.events[index].event
        match event:
            case GraphChanged():
                continue  # A change of the map is only the consequence of a setback.
            case Localised():
                node, edge = node if event.node is None else event.node, None
            case AttemptStarted(source=source, target=target):
                edge = None if source is None else (source, target)
            case Planned(nodes=nodes, cost=cost) if nodes:
                setback = None if cost < cheapest_before - _NEARER else setback
                cheapest = min(cheapest, cost)
            case _:
                pass
        description = describe_event(event)
        if description.severity is Severity.INFO:
            continue
        found = Setback(index, description.sentence, edge, node)
        if isinstance(event, Collided):
            collisions.append(found)
        if setback is None:
            setback, cheapest_before = found, cheapest
    if query.outcome is Outcome.COLLISION_LIMIT and collisions:
        # The first collision at the node with the most, even if the robot recovered from it.
        counts = Counter(collision.node for collision in collisions)
        return max(collisions, key=lambda collision: counts[collision.node])
    if setback is None or query.outcome is Outcome.ARRIVED:  # The robot was sure that it had arrived.
        off = f", {query.judged.position_error_m:.2f} m from the goal" if query.judged else ""
        return Setback(query.last, f"The query ended: {query.outcome}{off}.", None, node)
    return setback


def _same_place(first: FailedQuery, other: FailedQuery, radius_m: float) -> bool:
    if first.pose is None or other.pose is None or first.query.epoch != other.query.epoch:
        return (first.node, first.query.epoch) == (other.node, other.query.epoch)
    return hypot(first.pose.x_m - other.pose.x_m, first.pose.y_m - other.pose.y_m) <= radius_m
