"""Everything there is to know of one edge, over time: the edge microscope.

Owns the putting together. Says nothing in words (`analysis.blame`) and draws nothing (`analysis.projection` says where
in a picture a waypoint lies).
"""

from collections.abc import Collection
from dataclasses import dataclass

from ltvn_core.analysis.timeline import Attempt, Instant, MapChange, Timeline
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, NodeDropped, PoseRow
from ltvn_core.graph.topograph import EdgeKey
from ltvn_core.nav.events import LegEnd, Localised
from ltvn_core.types import FrameId, NodeId


@dataclass(frozen=True, slots=True)
class BeliefAt:
    """What was believed of an edge from an instant on."""

    instant: Instant
    belief: Belief
    attempts: int
    successes: int
    cause: Cause
    attempt: int | None
    """The leg that taught it; None at birth."""


@dataclass(frozen=True, slots=True)
class EdgeEnd:
    """How an edge left the map."""

    instant: Instant
    cause: Cause
    node: NodeId | None
    """The node with which it went; None if the edge itself was pruned, or the whole map was replaced."""
    attempt: int | None
    """The leg after which it was pruned."""
    whole_map: bool = False
    """It went because another map came in."""


@dataclass(frozen=True, slots=True)
class EdgeLife:
    """An edge from coming in to going out; one that comes back lives again."""

    epoch: int
    born: Instant
    cause: Cause
    waypoint: PoseRow
    """The target in the source's frame, as predicted when it was made."""
    protected: bool
    history: tuple[BeliefAt, ...]
    """Oldest first, the belief at birth included."""
    end: EdgeEnd | None
    """None while it lives."""

    @property
    def r_at_birth(self) -> float | None:
        """r of the prediction, as far as the cap of p lets it be seen; None if it had been driven before it came in."""
        first = self.history[0]
        return None if first.attempts else first.belief.p


@dataclass(frozen=True, slots=True)
class AttemptRow:
    """A leg along the edge."""

    attempt: int
    query: int
    begin: Instant
    localised: Localised | None
    """Where the robot thought it was before it set off."""
    departure: FrameId
    """The image at departure."""
    waypoint: PoseRow
    """The leg's target as seen from there."""
    departure_reachability: float
    arrival: FrameId | None
    """The image at arrival; None, like all below, if the recording is cut before."""
    end: LegEnd | None
    ended: Instant | None
    succeeded: bool | None
    reason: str
    distance: float | None
    """d from the arrival image to the target."""
    reachability: float | None
    collisions: int
    whole: bool
    """The leg was this edge alone; else it drove on past its end, and success says less."""
    counted: bool
    """It changed the belief; another failure in the same query does not."""


@dataclass(frozen=True, slots=True)
class EdgeStory:
    """All of an edge; without `lives` it never was in the map."""

    source: NodeId
    target: NodeId
    lives: tuple[EdgeLife, ...]
    attempts: tuple[AttemptRow, ...]
    planned: tuple[Instant, ...]
    """When a plan led through it."""

    @property
    def alive(self) -> bool:
        """It is in the map at the end of the timeline."""
        return bool(self.lives) and self.lives[-1].end is None

    @property
    def belief(self) -> Belief | None:
        """What was believed of it last."""
        return self.lives[-1].history[-1].belief if self.lives else None


def edge_story(timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None) -> EdgeStory:
    """Tell the life of an edge up to an instant; linear in plans and in what happened to it.

    Once per timeline linear in events. An edge that never was gives an empty story.
    """
    count = timeline.count_until(until)
    changes = timeline.changes_of_edge(source, target)
    taught = {(change.query, change.attempt) for change in changes if isinstance(change.delta, BeliefUpdated)}
    attempts = [leg for leg in timeline.attempts_of_edge(source, target) if leg.event < count]
    rows = tuple(_row(leg, (source, target), taught) for leg in attempts)
    plans = [plan for plan in timeline.plans if plan.event < count and (source, target) in plan.edges]
    lives = _lives(timeline, source, target, count)
    return EdgeStory(source, target, lives, rows, tuple(plan.instant for plan in plans))


@dataclass(slots=True)
class _Life:
    """A life that is still being told."""

    birth: MapChange
    edge: Edge
    history: list[BeliefAt]
    end: EdgeEnd | None = None

    def told(self) -> EdgeLife:
        edge, birth = self.edge, self.birth
        fixed = birth.epoch, birth.instant, birth.delta.cause, edge.waypoint, edge.protected
        return EdgeLife(*fixed, tuple(self.history), self.end)


def _lives(timeline: Timeline, source: NodeId, target: NodeId, count: int) -> tuple[EdgeLife, ...]:
    lives: list[_Life] = []
    for change in _concerning(timeline, source, target):
        if change.event < count:
            _end_with_its_map(lives, timeline, change.epoch)
            _live_on(lives, change)
    _end_with_its_map(lives, timeline, max((change.epoch for change in timeline.changes_before(count)[-1:]), default=0))
    return tuple(life.told() for life in lives)


def _concerning(timeline: Timeline, source: NodeId, target: NodeId) -> list[MapChange]:
    """Return what happened to an edge, and the departures of its nodes, in order."""
    ends = [*timeline.changes_of_node(source), *timeline.changes_of_node(target)]
    dropped = [change for change in ends if isinstance(change.delta, NodeDropped)]
    return sorted([*timeline.changes_of_edge(source, target), *dropped], key=lambda change: change.event)


def _live_on(lives: list[_Life], change: MapChange) -> None:
    last, delta = next((life for life in lives[-1:] if life.end is None), None), change.delta
    match delta:
        case EdgeAdded() if last is None:
            edge = delta.edge
            first = BeliefAt(change.instant, edge.belief, edge.attempts, edge.successes, delta.cause, None)
            lives.append(_Life(change, edge, [first]))
        case BeliefUpdated() if last is not None:
            counts = delta.attempts, delta.successes
            last.history.append(BeliefAt(change.instant, delta.belief, *counts, delta.cause, change.attempt))
        case EdgePruned() if last is not None:
            last.end = EdgeEnd(change.instant, delta.cause, None, change.attempt)
        case NodeDropped() if last is not None:
            last.end = EdgeEnd(change.instant, delta.cause, delta.node, None)
        case _:
            return  # It does not fit: the recording is damaged, or its beginning is missing.


def _end_with_its_map(lives: list[_Life], timeline: Timeline, epoch: int) -> None:
    """End an edge that went when another map came in."""
    if lives and lives[-1].end is None and lives[-1].birth.epoch < epoch:
        first = timeline.changes[timeline.epochs[lives[-1].birth.epoch + 1]]
        lives[-1].end = EdgeEnd(first.instant, first.delta.cause, None, None, whole_map=True)


def _row(attempt: Attempt, edge: EdgeKey, taught: Collection[tuple[int | None, int | None]]) -> AttemptRow:
    started, ended = attempt.started, attempt.ended
    return AttemptRow(
        attempt=started.attempt,
        query=started.query,
        begin=attempt.begin,
        localised=attempt.localised,
        departure=started.frame,
        waypoint=started.waypoint,
        departure_reachability=started.reachability,
        arrival=ended.frame if ended else None,
        end=ended.end if ended else None,
        ended=attempt.end,
        succeeded=ended.succeeded if ended else None,
        reason=ended.reason if ended else "the recording ends before the leg does",
        distance=ended.distance if ended else None,
        reachability=ended.reachability if ended else None,
        collisions=attempt.collisions,
        whole=(started.source, started.target) == edge,
        counted=(started.query, started.attempt) in taught,
    )
