"""Why an episode failed, told from its events and from where the robot truly was.

Owns the decision, as a short list in `EpisodeWitness.failure`; the sums behind it are `evaluate.blame`.
"""

from collections import Counter
from dataclasses import dataclass

from ltvn_core.analysis.triage import WASTED_SHARE
from ltvn_core.evaluate.blame import Blame, Turn
from ltvn_core.evaluate.results import Failure
from ltvn_core.evaluate.truth import MapTruth
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.nav.events import (
    JAMMED,
    Collided,
    Event,
    Judged,
    LegEnded,
    LegStarted,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
)
from ltvn_core.types import FrameId, Pose


@dataclass(frozen=True, slots=True)
class Sightings:
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
    trigger: Failure | None = None
    """What went wrong first since all was last well: a spurious edge may lead to where a robot is then astray."""


class EpisodeWitness:
    """Follows one episode; cheap enough to follow all."""

    def __init__(self, truth: MapTruth, graph: TopologicalGraph) -> None:
        """Watch a robot in `graph`, which may change on the way."""
        self._truth, self._graph = truth, graph
        self._blame = Blame()
        self._counts: Counter[str] = Counter()
        self._turn: Turn | None = None
        self._last: Turn | None = None
        self._latest: FrameId = 0
        self._trigger: Failure | None = None
        self._is_astray = False
        self._astray_plans = 0

    @property
    def sightings(self) -> Sightings:
        """What was seen so far."""
        return Sightings(**self._counts, trigger=self._trigger)

    def consume(self, event: Event, exact_pose: Pose | None = None) -> None:
        """Take in the next event, and where the robot truly is then, (3,).

        The pose counts with `Localised`; without it the robot is held to be where it thinks.
        """
        if isinstance(event, Localised):
            self._close(event.frame)
            self._turn = Turn(event.frame)
            self._localised(self._turn, event, exact_pose)
        elif self._turn is not None:
            self._in_turn(self._turn, event)

    def failure(self, ended: QueryEnded, judged: Judged) -> Failure | None:
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
                return None if judged.reached else Failure.WRONG_ARRIVAL
            case Outcome.NO_PATH:
                astray = 2 * self._astray_plans >= self._counts["no_path"] > 0
                return Failure.MISLOCALISED if astray else Failure.NO_PATH
            case Outcome.LOST:
                return (self._last.cause if self._last else None) or Failure.NO_PATH
            case Outcome.COLLISION_LIMIT:
                return self._blame.of_touches()
            case _:
                wasted = self._blame.wasted_steps
                return self._blame.of_steps() if wasted and wasted >= WASTED_SHARE * ended.steps else Failure.STEP_LIMIT

    def _localised(self, turn: Turn, event: Localised, exact_pose: Pose | None) -> None:
        """See whether it is right; a look at nothing it should know belongs to what went wrong before it."""
        if event.node is not None:
            self._is_astray = exact_pose is not None and not self._truth.is_at(exact_pose, event.node)
            self._counts["astray"] += self._is_astray
            turn.causes |= {Failure.MISLOCALISED} if self._is_astray else set()
        elif exact_pose is not None and self._truth.is_beside_one(exact_pose, self._graph.nodes):
            self._counts["unrecognised"] += 1
            turn.causes.add(Failure.MISLOCALISED)
        else:
            self._counts["off_the_map"] += 1
            turn.causes |= (self._last.causes if self._last else set()) or {Failure.NO_PATH}

    def _in_turn(self, turn: Turn, event: Event) -> None:
        match event:
            case Planned(nodes=()):
                self._counts["no_path"] += 1
                self._astray_plans += self._is_astray
                turn.causes.add(Failure.NO_PATH)
            case LegStarted():
                self._leg_started(turn, event)
            case LegEnded():
                self._leg_ended(turn, event)
            case Collided():
                turn.touches += 1
            case _:
                pass

    def _leg_started(self, turn: Turn, event: LegStarted) -> None:
        self._counts["legs"] += 1
        if event.source is not None and self._truth.is_spurious((event.source, event.target)):
            self._counts["spurious_legs"] += 1
            turn.causes.add(Failure.SPURIOUS_EDGE)

    def _leg_ended(self, turn: Turn, event: LegEnded) -> None:
        self._latest = event.frame
        if event.end in JAMMED:
            self._counts["blocked_legs"] += 1
            turn.causes.add(Failure.COLLISION)

    def _close(self, end: FrameId) -> None:
        if self._turn is not None:
            self._blame.add(self._turn, end)
            self._trigger = self._turn.cause and (self._trigger or self._turn.cause)
            self._last, self._turn = self._turn, None
