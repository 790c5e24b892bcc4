"""The history of one edge: when it was in the map, its beliefs, and all attempts to drive it.

Owns this collection, and the projection of a predicted waypoint into an image. Pixels count from the left upper corner
of the image; the centre of the first pixel is (0.5, 0.5). Makes no text (see `analysis.edge_explanation`) and no
drawing.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, MapChange
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.graph import deltas as d
from ltvn_core.navigation.events import AttemptEnded, Collided
from ltvn_core.types import NodeId, Waypoint


@dataclass(frozen=True, slots=True)
class TimedBelief:
    """The belief of an edge, valid from an instant on."""

    instant: Instant
    belief: d.Belief
    attempts: int
    successes: int
    cause: d.Cause
    attempt: int | None
    """The attempt that led to this belief; None for the belief with which the edge was added, or one set by hand."""


@dataclass(frozen=True, slots=True)
class EdgeRemoval:
    """When and why an edge was removed from the map."""

    instant: Instant
    cause: d.Cause
    node: NodeId | None
    """The node whose removal also removed the edge; None if the edge itself was pruned, or the whole map was
    replaced."""
    attempt: int | None
    """The attempt after which the edge was pruned; None if no attempt led to it."""
    whole_map: bool = False
    """Whether the edge was removed because another map replaced this one."""


@dataclass(frozen=True, slots=True)
class EdgeLifetime:
    """The time from the addition of an edge to its removal; an edge that is added again has another lifetime."""

    epoch: int
    added_at: Instant
    cause: d.Cause
    waypoint: d.PoseRow
    """The target in the source's frame, as predicted when the edge was made."""
    protected: bool
    by_odometry: bool
    """Whether the edge comes from odometry alone."""
    beliefs: tuple[TimedBelief, ...]
    """All beliefs, oldest first, including the one with which the edge was added."""
    end: EdgeRemoval | None
    """The removal; None while the edge is in the map."""

    @property
    def initial_reachability(self) -> float | None:
        """r of the prediction, limited by the cap of p; None if the edge had been driven before it was added."""
        first = self.beliefs[0]
        return None if first.attempts else first.belief.p


class EdgeAttempt(NamedTuple):
    """An attempt along the edge."""

    record: AttemptRecord
    """The attempt; without its verdict while it is in progress, or if the recording ends before."""
    only_this_edge: bool
    """Whether the attempt drove this edge alone. Otherwise it continued past the end of the edge, and its success is
    weaker evidence."""
    changed_belief: bool
    """Whether the attempt changed the belief; a repeated failure in the same query does not."""

    @property
    def number(self) -> int:
        """Number of the attempt."""
        return self.record.started.attempt

    @property
    def query(self) -> int:
        """Number of its query."""
        return self.record.started.query

    @property
    def begin(self) -> Instant:
        """The instant of its start."""
        return self.record.begin

    @property
    def ended(self) -> AttemptEnded | None:
        """Its verdict; None without one."""
        return self.record.ended


@dataclass(frozen=True, slots=True)
class EdgeHistory:
    """The history of one edge; `lifetimes` is empty if the edge never was in the map."""

    source: NodeId
    target: NodeId
    lifetimes: tuple[EdgeLifetime, ...]
    attempts: tuple[EdgeAttempt, ...]
    planned_at: tuple[Instant, ...]
    """Instants of the plans through the edge."""

    @property
    def alive(self) -> bool:
        """Whether the edge is in the map at the given instant, or at the end of the timeline."""
        return bool(self.lifetimes) and self.lifetimes[-1].end is None

    @property
    def belief(self) -> d.Belief | None:
        """The last belief; None if the edge never was in the map."""
        return self.lifetimes[-1].beliefs[-1].belief if self.lifetimes else None


def edge_history(timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None) -> EdgeHistory:
    """Return the history of an edge up to an instant; empty if the edge was never in the map.

    Linear in the plans and in the changes of the edge.
    """
    count = timeline.count_until(until)
    changes = [change for change in timeline.changes_of_edge(source, target) if change.event < count]
    belief_changes = {(change.query, change.attempt) for change in changes if isinstance(change.delta, d.BeliefUpdated)}
    begun = (attempt for attempt in timeline.attempts_of_edge(source, target) if attempt.event < count)
    attempts = [
        EdgeAttempt(
            attempt if until is None else _known_at(timeline, attempt, until),
            only_this_edge=(attempt.started.source, attempt.started.target) == (source, target),
            changed_belief=(attempt.started.query, attempt.started.attempt) in belief_changes,
        )
        for attempt in begun
    ]
    plans = [plan for plan in timeline.plans if plan.event < count and (source, target) in plan.edges]
    return EdgeHistory(
        source=source,
        target=target,
        lifetimes=_lifetimes(timeline, source, target, count),
        attempts=tuple(attempts),
        planned_at=tuple(plan.instant for plan in plans),
    )


def _known_at(timeline: Timeline, attempt: AttemptRecord, instant: Instant) -> AttemptRecord:
    """Return an attempt as known after a step: without its verdict while it was in progress."""
    if attempt.end is not None and attempt.end.step <= instant.step:
        return attempt
    so_far = timeline.events[attempt.event : timeline.count_until(instant)]
    collisions = sum(isinstance(stamped.event, Collided) for stamped in so_far)
    return replace(attempt, end=None, ended=None, collisions=min(collisions, attempt.collisions))


@dataclass(slots=True)
class _OpenLifetime:
    """A lifetime that is still being built from the changes."""

    addition: MapChange
    edge: d.Edge
    beliefs: list[TimedBelief]
    end: EdgeRemoval | None = None

    def finished(self) -> EdgeLifetime:
        return EdgeLifetime(
            epoch=self.addition.epoch,
            added_at=self.addition.instant,
            cause=self.addition.delta.cause,
            waypoint=self.edge.waypoint,
            protected=self.edge.protected,
            by_odometry=self.edge.by_odometry,
            beliefs=tuple(self.beliefs),
            end=self.end,
        )


def _lifetimes(timeline: Timeline, source: NodeId, target: NodeId, count: int) -> tuple[EdgeLifetime, ...]:
    """Walk over the changes of an edge and the removals of its nodes before event number `count`."""
    ends = [*timeline.changes_of_node(source), *timeline.changes_of_node(target)]
    dropped = [change for change in ends if isinstance(change.delta, d.NodeDropped)]
    lifetimes: list[_OpenLifetime] = []
    for change in sorted([*timeline.changes_of_edge(source, target), *dropped], key=lambda change: change.event):
        if change.event < count:
            _end_with_its_map(lifetimes, timeline, change.epoch)
            _take_change(lifetimes, change)
    last = timeline.change_count_before(count) - 1
    _end_with_its_map(lifetimes, timeline, timeline.changes[last].epoch if last >= 0 else 0)
    return tuple(life.finished() for life in lifetimes)


def _take_change(lifetimes: list[_OpenLifetime], change: MapChange) -> None:
    """Take in a change; one that does not fit is skipped, as the recording is damaged, or its beginning is missing."""
    last = next((life for life in lifetimes[-1:] if life.end is None), None)
    match change.delta:
        case d.EdgeAdded(edge, cause) if last is None:
            first = TimedBelief(change.instant, edge.belief, edge.attempts, edge.successes, cause, attempt=None)
            lifetimes.append(_OpenLifetime(addition=change, edge=edge, beliefs=[first]))
        case d.BeliefUpdated(_, _, belief, attempts, successes, cause) if last is not None:
            last.beliefs.append(TimedBelief(change.instant, belief, attempts, successes, cause, change.attempt))
        case d.EdgePruned(cause=cause) if last is not None:
            last.end = EdgeRemoval(change.instant, cause, node=None, attempt=change.attempt)
        case d.NodeDropped(node, cause) if last is not None:
            last.end = EdgeRemoval(change.instant, cause, node, attempt=None)
        case _:
            pass


def _end_with_its_map(lifetimes: list[_OpenLifetime], timeline: Timeline, epoch: int) -> None:
    """End the last lifetime if another map has replaced its map."""
    if lifetimes and lifetimes[-1].end is None and lifetimes[-1].addition.epoch < epoch:
        first = timeline.changes[timeline.epochs[lifetimes[-1].addition.epoch + 1]]
        lifetimes[-1].end = EdgeRemoval(
            instant=first.instant, cause=first.delta.cause, node=None, attempt=None, whole_map=True
        )


_NEAREST_M = 0.05
"""Points nearer to the camera than this are not projected, in metres."""


class Pixel(NamedTuple):
    """A position in an image, in pixels; not rounded."""

    u: float
    """Pixels to the right."""
    v: float
    """Pixels down."""


def pole_in_image(waypoint: Waypoint, camera: CameraModel) -> tuple[Pixel, Pixel] | None:
    """Return the top and the foot of a vertical pole at a waypoint (3,), as high as the camera, clipped to the image.

    None if the pole is outside the image or behind the camera. For an edge that is driven backwards, use the image of
    its target.
    """
    top, foot = (_projected(waypoint, camera, height) for height in (camera.height_m, 0.0))
    if top is None or foot is None:
        return None
    ends = np.array([top, foot])
    begin = 0.0
    end = 1.0
    for start, stop, size in zip(ends[0], ends[1], (camera.width, camera.height), strict=True):
        slope = stop - start
        if abs(slope) < 1e-9:
            begin, end = (begin, end) if 0 <= start <= size else (1.0, 0.0)
            continue
        first, last = sorted(((0 - start) / slope, (size - start) / slope))
        begin = max(begin, first)
        end = min(end, last)
    if begin > end:
        return None
    cut = [ends[0] + share * (ends[1] - ends[0]) for share in (begin, end)]
    return Pixel(*map(float, cut[0])), Pixel(*map(float, cut[1]))


def _projected(waypoint: Waypoint, camera: CameraModel, height_m: float) -> Pixel | None:
    """Project a point onto the image plane, also outside the image; None if it is not in front of the camera."""
    point = np.array([waypoint[0], waypoint[1], height_m], np.float64)
    if float((point - [0.0, 0.0, camera.height_m]) @ camera.rotation[:, 0]) < _NEAREST_M:
        return None
    u, v = camera.project(point) + 0.5
    return Pixel(float(u), float(v))
