"""The story itself: what happens next, and what is told of it. Drives nothing; the page and a headless run play it.

Whoever plays it hands every event to `take`, asks `next_step` at each control step and does what it says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias

from ltvn_core.evaluation.door_story.story_facts import StoryFacts
from ltvn_core.evaluation.door_story.story_map import Stage, StoryMap
from ltvn_core.navigation.events import Event, Outcome, Planned, QueryEnded
from ltvn_core.types import NodeId
from ltvn_core.worlds.world_change import DoorMoved, TimePassed, WorldChange

STORY_MAINTENANCE = "persistent"
"""What driving teaches the map in a story."""
STEPS_AT_DOOR = 80
"""So often the robot is asked for its next step at a closed door before it is called back."""
NO_STORY = (
    "No way in this map leads from here through a door. Drive or navigate to another room, or map more of them, and "
    "try again."
)


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive to a node now."""

    node: NodeId


@dataclass(frozen=True, slots=True)
class Change:
    """Change the world now."""

    change: WorldChange


@dataclass(frozen=True, slots=True)
class CallBack:
    """End the query under way now."""


StoryStep: TypeAlias = GoTo | Change | CallBack


class _Phase(Enum):
    BEGINNING = auto()
    GOING = auto()
    REOPENING = auto()
    WAITING = auto()
    RETURNING = auto()
    OVER = auto()


class DoorStory:
    """One story, from its beginning to its end."""

    def __init__(self, story_map: StoryMap, door_names: Sequence[str]) -> None:
        """Play in a map whose doors a person calls by these names."""
        self._map, self._names = story_map, door_names
        self.facts = StoryFacts()
        self.captions: list[str] = []
        """What was told so far."""
        self._phase = _Phase.BEGINNING
        self._stage: Stage | None = None
        self._is_closed = False
        self._plan: tuple[NodeId, ...] = ()
        self._told: set[str] = set()
        self._arrived = False
        self._steps_at_door = 0
        self._goals: list[NodeId] = []
        """Where to go once the door is open again."""
        self._is_called_back = False

    @property
    def is_over(self) -> bool:
        """Whether there is nothing more to do."""
        return self._phase is _Phase.OVER

    @property
    def stage(self) -> Stage | None:
        """Where it plays; None before it began, and where it cannot."""
        return self._stage

    def take(self, event: Event) -> None:
        """Look at what happened."""
        before = len(self.facts.absent), self.facts.added, len(self.facts.returned)
        self.facts.take(event)
        if self._phase not in (_Phase.GOING, _Phase.RETURNING):
            return
        match event:
            case Planned(nodes=nodes) if nodes:
                self._plan = nodes
                self._tell_of_plan()
            case QueryEnded(outcome=outcome):
                self._tell_of_end(outcome)
            case _:
                self._tell_of_map(*before)

    def next_step(self, *, is_idle: bool) -> StoryStep | None:
        """Return what to do now, if anything; `is_idle` says that the robot stands and waits for a goal."""
        stage = self._stage
        if self._phase is _Phase.BEGINNING and is_idle:
            return self._begin()
        if stage is None:
            return None
        if self._phase is _Phase.GOING and not self._is_closed and self._map.passes(self._plan, stage.door):
            self._is_closed = True
            self._tell(f"Somebody closes {self._door}. The robot does not know it yet.")
            return Change(DoorMoved(stage.door, is_open=False))
        if self._phase is _Phase.GOING and self.facts.absent and not stage.has_way_round and not self._is_called_back:
            return self._wait_a_little()
        if self._phase is _Phase.REOPENING and is_idle:
            return self._reopen(stage)
        if self._phase is _Phase.WAITING and is_idle:
            self._phase = _Phase.RETURNING
            return GoTo(self._goals.pop(0))
        return None

    def stop(self, why: str) -> StoryStep | None:
        """End it early and say why; returns what to do yet."""
        self._phase = _Phase.OVER
        self._tell(why)
        if self._stage is None or not self._is_closed:
            return None
        self._is_closed = False
        return Change(DoorMoved(self._stage.door, is_open=True))

    @property
    def _door(self) -> str:
        return "the door" if self._stage is None else f"the door {self._names[self._stage.door]}"

    def _begin(self) -> StoryStep | None:
        self._stage = self._map.stage()
        if self._stage is None:
            self._phase = _Phase.OVER
            self._tell(NO_STORY)
            return None
        self._phase = _Phase.GOING
        other = "There is another way." if self._stage.has_way_round else "Its map has no other."
        self._tell(f"The robot sets out for node {self._stage.goal}. The way leads through {self._door}. {other}")
        return GoTo(self._stage.goal)

    def _reopen(self, stage: Stage) -> StoryStep:
        if self._is_closed:
            self._is_closed = False
            self._tell(f"{self._door[:1].upper()}{self._door[1:]} is opened again. Nobody tells the robot.")
            return Change(DoorMoved(stage.door, is_open=True))
        self._goals = self._goals_again(stage)
        wait_s = self._map.wait_s(stage.door, self._goals[0])
        self._phase = _Phase.WAITING
        what = "is sent back" if self._arrived else "is sent there again"
        self._tell(f"{_duration(wait_s)} go by, and the robot {what}.")
        return Change(TimePassed(wait_s))

    def _wait_a_little(self) -> StoryStep | None:
        """Let the robot look at the closed door for a while; then there is nothing left for it to do."""
        self._steps_at_door += 1
        if self._steps_at_door < STEPS_AT_DOOR:
            return None
        self._is_called_back = True
        self._tell("The map knows no other way, so the robot is called back.")
        return CallBack()

    def _goals_again(self, stage: Stage) -> list[NodeId]:
        """Return where to go until an edge comes back: where the story began or was to end, and along an edge itself.

        A map has several edges through a door; the shortest way may lead along one that was never seen blocked.
        """
        ends = list(self.facts.absent[0]) if self.facts.absent else []
        return [stage.start, *ends] if self._arrived else [*ends, stage.goal]

    def _tell_of_plan(self) -> None:
        if self._stage is None:
            return
        through = self._map.passes(self._plan, self._stage.door)
        if self._phase is _Phase.GOING and self._is_closed and not through:
            self.facts.rerouted = True
            self._tell_once("turned", f"The plan turns: round about, by {len(self._plan)} nodes.")
        if self._phase is _Phase.RETURNING and through:
            self._tell_once("tried again", "The plan leads through the door again: it is worth a try by now.")

    def _tell_of_map(self, absent: int, added: int, returned: int) -> None:
        facts = self.facts
        if not absent and facts.absent:
            self._tell(
                "The robot stands before a closed door. The edges through it fade: absent now, and not forgotten."
            )
        if not added and facts.added:
            what = "A new node" if facts.nodes_added else "A new edge"
            self._tell(f"{what} appears in the map: the robot learned it on the way.")
        if not returned and facts.returned:
            self._tell("The way is open. The edges through the door return.")

    def _tell_of_end(self, outcome: Outcome) -> None:
        if outcome is Outcome.CANCELLED and self._phase is _Phase.GOING and self._is_called_back:
            self._phase = _Phase.REOPENING
            return
        if outcome is Outcome.CANCELLED:
            return  # Whoever cancelled it stops the story.
        ended = "arrived" if outcome is Outcome.ARRIVED else f"gives up ({outcome})"
        if self._phase is _Phase.RETURNING and not self.facts.returned and self._goals:
            self._phase = _Phase.WAITING
        elif self._phase is _Phase.RETURNING:
            self._phase = _Phase.OVER
            self._tell(f"The robot {ended}. {self._summary()}")
        elif not self._is_closed:
            self._phase = _Phase.OVER
            self._tell("The robot found a way that does not lead through the door. Try again from another place.")
        else:
            self._phase = _Phase.REOPENING
            self._arrived = outcome is Outcome.ARRIVED
            self._tell(f"The robot {ended}.")

    def _summary(self) -> str:
        facts = self.facts
        return (
            f"Learned: {len(facts.absent)} edges were absent for a while, {len(facts.returned)} of them are back; "
            f"{facts.nodes_added} nodes and {facts.edges_added} edges are new."
        )

    def _tell_once(self, about: str, text: str) -> None:
        if about not in self._told:
            self._told.add(about)
            self._tell(text)

    def _tell(self, text: str) -> None:
        self.captions.append(text)


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 3600 else f"{seconds / 3600:.0f} hours"
