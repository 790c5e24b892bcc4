"""Why an episode failed, told from its events and from where the robot truly was.

Owns the decision, as a short list in `FailureClassifier.failure`; the sums behind it are `evaluate.blame`.
"""

from collections import Counter
from dataclasses import dataclass

from ltvn_core.analysis.failure_triage import WASTED_SHARE
from ltvn_core.evaluation.failure_attribution import EpisodeSegment, FailureAttribution
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.results import FailureCause
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import (
    OBSTRUCTED_ENDS,
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    Judged,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
)
from ltvn_core.types import FrameId, Pose


@dataclass(frozen=True, slots=True)
class EpisodeStatistics:
    """What a person wants to know of an episode beside its cause."""

    legs: int = 0
    spurious_legs: int = 0
    """Legs along edges that nobody can drive."""
    astray: int = 0
    """Localisations at a node where the robot was not."""
    unrecognised: int = 0
    """Looks that found no node although one was right there."""
    off_the_map: int = 0
    """Looks that found no node, and none was right there."""
    no_path: int = 0
    """Plans in vain."""
    blocked_legs: int = 0
    """Legs that ended at an obstacle, seen or touched."""
    trigger: FailureCause | None = None
    """What went wrong first since all was last well: a spurious edge may lead to where a robot is then astray."""


class FailureClassifier:
    """Follows one episode; cheap enough to follow all."""

    def __init__(self, truth: GroundTruth, graph: TopologicalGraph) -> None:
        """Watch a robot in `graph`, which may change on the way."""
        self._truth = truth
        self._graph = graph
        self._attribution = FailureAttribution()
        self._counts: Counter[str] = Counter()
        self._segment: EpisodeSegment | None = None
        self._last: EpisodeSegment | None = None
        self._latest: FrameId = 0
        self._trigger: FailureCause | None = None
        self._is_mislocalised = False
        self._mislocalised_plans = 0

    @property
    def statistics(self) -> EpisodeStatistics:
        """What was seen so far."""
        return EpisodeStatistics(**self._counts, trigger=self._trigger)

    def consume(self, event: Event, exact_pose: Pose | None = None) -> None:
        """Take in the next event, and where the robot truly is then, (3,).

        The pose counts with `Localised`; without it the robot is held to be where it thinks.
        """
        if isinstance(event, Localised):
            self._close(event.frame)
            self._segment = EpisodeSegment(event.frame)
            self._localised(self._segment, event, exact_pose)
        elif self._segment is not None:
            self._in_segment(self._segment, event)

    def failure(self, ended: QueryEnded, judged: Judged) -> FailureCause | None:
        """Return the one cause of a failure, None if the robot arrived and said so. The first that holds:

        1. It said that it had arrived: WRONG_ARRIVAL.
        2. It saw no path: MISLOCALISED if it was astray in at least half of the plans in vain, else NO_PATH.
        3. It was lost: MISLOCALISED if it did not recognise a node that was right there; else what went wrong when it
           drove there; else NO_PATH, for the map does not know that place.
        4. It touched things too often: what most touches were put down to.
        5. It ran out of steps, or was cut short: what most of the wasted steps were put down to, if they are a third
           of all; else STEP_LIMIT.
        """
        self._close(self._latest)
        match ended.outcome:
            case Outcome.ARRIVED:
                return None if judged.reached else FailureCause.WRONG_ARRIVAL
            case Outcome.NO_PATH:
                astray = 2 * self._mislocalised_plans >= self._counts["no_path"] > 0
                return FailureCause.MISLOCALISED if astray else FailureCause.NO_PATH
            case Outcome.LOST:
                return (self._last.cause if self._last else None) or FailureCause.NO_PATH
            case Outcome.COLLISION_LIMIT:
                return self._attribution.main_collision_cause()
            case Outcome.STEP_LIMIT | Outcome.CANCELLED:
                wasted = self._attribution.wasted_steps
                return (
                    self._attribution.main_waste_cause()
                    if wasted and wasted >= WASTED_SHARE * ended.steps
                    else FailureCause.STEP_LIMIT
                )

    def _localised(self, segment: EpisodeSegment, event: Localised, exact_pose: Pose | None) -> None:
        """See whether it is right; a look at nothing it should know belongs to what went wrong before it."""
        if event.node is not None:
            self._is_mislocalised = exact_pose is not None and not self._truth.is_at(exact_pose, event.node)
            self._counts["astray"] += self._is_mislocalised
            segment.causes |= {FailureCause.MISLOCALISED} if self._is_mislocalised else set()
        elif exact_pose is not None and self._truth.should_recognise_one(exact_pose, self._graph.nodes):
            self._counts["unrecognised"] += 1
            segment.causes.add(FailureCause.MISLOCALISED)
        else:
            self._counts["off_the_map"] += 1
            segment.causes |= (self._last.causes if self._last else set()) or {FailureCause.NO_PATH}

    def _in_segment(self, segment: EpisodeSegment, event: Event) -> None:
        if isinstance(event, Planned) and not event.nodes:
            self._counts["no_path"] += 1
            self._mislocalised_plans += self._is_mislocalised
            segment.causes.add(FailureCause.NO_PATH)
        elif isinstance(event, AttemptStarted):
            self._attempt_started(segment, event)
        elif isinstance(event, AttemptEnded):
            self._attempt_ended(segment, event)
        elif isinstance(event, Collided):
            segment.collisions += 1

    def _attempt_started(self, segment: EpisodeSegment, event: AttemptStarted) -> None:
        self._counts["legs"] += 1
        if event.source is not None and self._truth.is_spurious((event.source, event.target)):
            self._counts["spurious_legs"] += 1
            segment.causes.add(FailureCause.SPURIOUS_EDGE)

    def _attempt_ended(self, segment: EpisodeSegment, event: AttemptEnded) -> None:
        self._latest = event.frame
        if event.end in OBSTRUCTED_ENDS:
            self._counts["blocked_legs"] += 1
            segment.causes.add(FailureCause.COLLISION)

    def _close(self, end: FrameId) -> None:
        if self._segment is not None:
            self._attribution.add(self._segment, end)
            self._trigger = self._segment.cause and (self._trigger or self._segment.cause)
            self._last = self._segment
            self._segment = None
