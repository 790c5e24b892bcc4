"""Calibration of p over queries: the belief of an edge before an attempt against the outcome of the attempt.

The calibration of a whole map at one time is in `ground_truth`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ltvn_core.analysis.map_replay import MapReplay
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import AttemptEnded, QueryEnded, StampedEvent


class CalibrationAttempt(NamedTuple):
    """One attempt at an edge: its p before, the outcome by the robot's own criterion, and the true outcome."""

    instant: Instant
    """Of its end."""
    query: int
    edge: EdgeKey
    p: float
    """Before the attempt."""
    succeeded: bool
    """By the robot's own judgement."""
    arrived: bool | None
    """By exact poses and the paper's criterion; None where the arrival image has no pose."""

    @property
    def drivable(self) -> bool:
        """Whether the robot arrived: by exact poses where they are known, else by its own criterion."""
        return self.succeeded if self.arrived is None else self.arrived


@dataclass(frozen=True, slots=True)
class CalibrationPoint:
    """Calibration of p over all attempts up to the end of a query."""

    query: int
    instant: Instant
    attempts: int
    mean_p: float
    """Mean p before the attempts."""
    succeeded: float
    """Share that succeeded by the robot's own judgement."""
    arrived: float | None
    """Share that truly arrived; None where it is unknown."""
    brier: float
    """Mean square of p minus true arrival (of the robot's judgement where that is unknown); 0 is best."""


def calibration_attempts(
    events: Sequence[StampedEvent], truth: GroundTruth | None = None
) -> tuple[CalibrationAttempt, ...]:
    """Return all attempts at edges that the map had then, in order; linear in events."""
    return tuple(each for each in _attempts_and_query_ends(events, truth) if isinstance(each, CalibrationAttempt))


def calibration_over_queries(
    events: Sequence[StampedEvent], truth: GroundTruth | None = None
) -> tuple[CalibrationPoint, ...]:
    """Return the calibration after each query that ended, over all attempts so far; linear in events."""
    sums = _RunningSums()
    points = []
    for each in _attempts_and_query_ends(events, truth):
        if isinstance(each, CalibrationAttempt):
            sums.add(each)
        elif sums.attempts:
            points.append(sums.point(each))
    return tuple(points)


class _RunningSums:
    """Running sums over attempts, so that the cost is linear in attempts."""

    def __init__(self) -> None:
        self.attempts = self._known = self._arrived = self._succeeded = 0
        self._p = self._square = 0.0

    def add(self, trial: CalibrationAttempt) -> None:
        self.attempts += 1
        self._p += trial.p
        self._succeeded += trial.succeeded
        self._known += trial.arrived is not None
        self._arrived += trial.arrived is True
        self._square += (trial.p - trial.drivable) ** 2

    def point(self, end: StampedEvent) -> CalibrationPoint:
        count = self.attempts
        query = end.event.query if isinstance(end.event, QueryEnded) else 0
        arrived = self._arrived / self._known if self._known else None
        return CalibrationPoint(
            query=query,
            instant=Instant(end.step, end.stamp),
            attempts=count,
            mean_p=self._p / count,
            succeeded=self._succeeded / count,
            arrived=arrived,
            brier=self._square / count,
        )


def _attempts_and_query_ends(
    events: Sequence[StampedEvent], truth: GroundTruth | None
) -> Iterator[CalibrationAttempt | StampedEvent]:
    """Yield each attempt, and each end of a query, in order."""
    timeline = Timeline.of(events)
    folding = MapReplay()
    changes = {change.event: change for change in timeline.changes}
    for index, stamped in enumerate(timeline.events):
        event = stamped.event
        if index in changes:
            folding.take(changes[index])
        elif isinstance(event, QueryEnded):
            yield stamped
        elif isinstance(event, AttemptEnded) and event.source is not None:
            edge = folding.graph.edges.get((event.source, event.target))
            if edge is not None:
                yield CalibrationAttempt(
                    instant=Instant(stamped.step, stamped.stamp),
                    query=event.query,
                    edge=(event.source, event.target),
                    p=edge.belief.p,
                    succeeded=event.succeeded,
                    arrived=_arrived(truth, event),
                )


def _arrived(truth: GroundTruth | None, attempt: AttemptEnded) -> bool | None:
    if truth is None or not (truth.knows(attempt.frame) and truth.knows(attempt.target)):
        return None
    return judge_goal_reached(attempt.query, truth.pose(attempt.frame), truth.pose(attempt.target)).reached
