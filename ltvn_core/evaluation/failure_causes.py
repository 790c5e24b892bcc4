"""Classifies why an episode failed, from its events and the exact poses of the robot.

An episode is divided into segments, each from one localisation to the next. A segment has at most one cause: the first
that applies, in the order of `CAUSE_ORDER`. `FailureClassifier.failure` lists the rules that derive the cause of the
failure from sums over segments.
"""

from collections import Counter
from dataclasses import dataclass, field

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import (
    OBSTRUCTED_ENDS,
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    Localised,
    Outcome,
    Planned,
)
from ltvn_core.types import FrameId, Pose

CAUSE_ORDER = (FailureCause.SPURIOUS_EDGE, FailureCause.MISLOCALISED, FailureCause.NO_PATH, FailureCause.COLLISION)
"""Causes in causal order: each cause may lead to the causes after it."""
WASTED_SHARE = 1 / 3
"""Share of wasted steps below which a query that reached the step limit has no other cause (ours)."""


@dataclass(slots=True)
class EpisodeSegment:
    """The part of an episode from one localisation to the next."""

    begin: FrameId
    """Step of the image."""
    causes: set[FailureCause] = field(default_factory=set)
    """Causes that apply to the segment."""
    collisions: int = 0

    @property
    def cause(self) -> FailureCause | None:
        """The first cause in causal order; None if nothing went wrong."""
        return next((cause for cause in CAUSE_ORDER if cause in self.causes), None)


class FailureClassifier:
    """Follows the events of one episode; fast enough to run in every episode."""

    def __init__(self, truth: GroundTruth, graph: TopologicalGraph) -> None:
        """Create a classifier for a robot in `graph`, which may change during the episode."""
        self._truth = truth
        self._graph = graph
        self._steps: Counter[FailureCause] = Counter()
        """Steps of all segments with a cause, by cause."""
        self._collisions: Counter[FailureCause] = Counter()
        """Collisions by the cause of their segment; those in a segment without one are the controller's."""
        self._segment: EpisodeSegment | None = None
        self._last: EpisodeSegment | None = None
        self._latest: FrameId = 0
        self.trigger: FailureCause | None = None
        """The first cause since the last correct localisation: a spurious edge may lead to a place where the robot is
        later mislocalised.
        """
        self.localised = 0
        """Number of localisations that found a node."""
        self.mislocalised = 0
        """Number of localisations that found a node at which the robot was not."""
        self._is_mislocalised = False
        self._plans_without_path = self._mislocalised_plans = 0

    def consume(self, event: Event, exact_pose: Pose | None = None) -> None:
        """Add the next event and the exact pose (3,) of the robot at that time.

        Only the pose of `Localised` is used; without one the localisation counts as correct.
        """
        if isinstance(event, Localised):
            self._close(event.frame)
            self._segment = EpisodeSegment(event.frame)
            self._localised(self._segment, event, exact_pose)
        elif self._segment is not None:
            self._in_segment(self._segment, event)

    def failure(self, ended: QueryResult) -> FailureCause | None:
        """Return the cause of a failure; None if the robot arrived and decided so. The first rule that applies counts:

        1. The robot decided that it had arrived: WRONG_ARRIVAL.
        2. It found no path: MISLOCALISED if it was mislocalised in at least half of the plans without a path; else
           NO_PATH.
        3. It was lost: MISLOCALISED if it did not recognise a node where it was; else the cause of the segment before;
           else NO_PATH, because the map does not contain that place.
        4. It collided too often: the cause with most collisions.
        5. It reached the step limit or was stopped: the cause with most steps, if all causes together have a third of
           the steps; else STEP_LIMIT.
        """
        self._close(self._latest)
        match Outcome(ended.outcome):
            case Outcome.ARRIVED:
                return None if ended.reached else FailureCause.WRONG_ARRIVAL
            case Outcome.NO_PATH:
                mislocalised = 2 * self._mislocalised_plans >= self._plans_without_path > 0
                return FailureCause.MISLOCALISED if mislocalised else FailureCause.NO_PATH
            case Outcome.LOST:
                return (self._last.cause if self._last else None) or FailureCause.NO_PATH
            case Outcome.COLLISION_LIMIT:
                found = self._collisions
                return _main_cause(found) if found.total() else FailureCause.COLLISION
            case Outcome.STEP_LIMIT | Outcome.CANCELLED:
                wasted = self._steps.total()
                has_cause = wasted and wasted >= WASTED_SHARE * ended.steps
                return _main_cause(self._steps) if has_cause else FailureCause.STEP_LIMIT

    def _localised(self, segment: EpisodeSegment, event: Localised, exact_pose: Pose | None) -> None:
        """Check a localisation; a failed localisation away from all nodes is attributed to the segment before it."""
        if event.node is not None:
            self._is_mislocalised = exact_pose is not None and not self._truth.is_at(exact_pose, event.node)
            self.localised += 1
            self.mislocalised += self._is_mislocalised
            segment.causes |= {FailureCause.MISLOCALISED} if self._is_mislocalised else set()
        elif exact_pose is not None and self._truth.should_recognise_one(exact_pose, self._graph.nodes):
            segment.causes.add(FailureCause.MISLOCALISED)
        else:
            segment.causes |= (self._last.causes if self._last else set()) or {FailureCause.NO_PATH}

    def _in_segment(self, segment: EpisodeSegment, event: Event) -> None:
        if isinstance(event, Planned) and not event.nodes:
            self._plans_without_path += 1
            self._mislocalised_plans += self._is_mislocalised
            segment.causes.add(FailureCause.NO_PATH)
        elif isinstance(event, AttemptStarted):
            if event.source is not None and self._is_spurious((event.source, event.target)):
                segment.causes.add(FailureCause.SPURIOUS_EDGE)
        elif isinstance(event, AttemptEnded):
            self._latest = event.frame
            if event.end in OBSTRUCTED_ENDS:
                segment.causes.add(FailureCause.COLLISION)
        elif isinstance(event, Collided):
            segment.collisions += 1

    def _is_spurious(self, key: EdgeKey) -> bool:
        edge = self._graph.edges.get(key)
        return self._truth.is_spurious(key, by_odometry=edge is not None and edge.by_odometry)

    def _close(self, end: FrameId) -> None:
        segment = self._segment
        if segment is not None:
            cause = segment.cause
            self._collisions[cause or FailureCause.COLLISION] += segment.collisions
            if cause is not None:
                self._steps[cause] += max(end - segment.begin, 0)
            self.trigger = cause and (self.trigger or cause)
            self._last = segment
            self._segment = None


def _main_cause(counts: Counter[FailureCause]) -> FailureCause:
    """Return the cause with the largest count; of equal ones the first in causal order."""
    return max(CAUSE_ORDER, key=lambda cause: counts[cause])
