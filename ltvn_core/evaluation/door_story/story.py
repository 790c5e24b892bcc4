"""The story itself: what happens next, and what is told of it. Drives nothing; the page and a headless run play it.

Whoever plays it hands every event to `take`, asks `next_step` at each control step and does what it says. Each thing
that happens is told in one plain sentence.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.door_story.story_map import Stage, StoryMap
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds.world_change import OWN_PREFIX, DoorMoved, ThingRemoved, TimePassed, WorldChange

NO_STORY = "No way in this map leads from here through a door. Map more rooms, and try again from one of them."
_SEVERAL = 3
"""A way that was not in the map gives so many nodes; one alone is no news."""
STORY_MAINTENANCE = "persistent"
"""What driving teaches the map in a story."""
MOST_TRIES = 2
"""So often it is sent out again where it went round without having seen why."""
STEPS_AT_DOOR, STEPS_BEYOND_DOOR = 80, 30
"""So often the robot is asked for its next step at a closed door, or at one that it found open, before it is called
back."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """Put the robot somewhere else now."""

    pose: Pose
    """(3,) in the world frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """Drive the robot by hand, and let the map grow from what it sees."""

    path: NDArray[np.float64]
    """(M, 2) x and y in metres."""


StoryStep: TypeAlias = GoTo | Change | CallBack | Carry | Lead


@dataclass
class StoryFacts:
    """Counts while the story goes on."""

    absent: list[EdgeKey] = field(default_factory=list)
    """Edges that were seen blocked, or pruned, in this order."""
    returned: set[EdgeKey] = field(default_factory=set)
    """Edges of these that were seen open later."""
    nodes_added: int = 0
    edges_added: int = 0
    rerouted: bool = False
    """Whether a plan turned away from the door."""

    @property
    def added(self) -> int:
        """Nodes and edges that driving brought in."""
        return self.nodes_added + self.edges_added

    @property
    def are_all_back(self) -> bool:
        """Whether every edge that was absent returned."""
        return bool(self.absent) and self.returned.issuperset(self.absent)

    def take(self, event: Event) -> None:
        """Count one event."""
        if not isinstance(event, GraphChanged):
            return
        match event.delta:
            case PresenceObserved(source, target, present):
                if not present and (source, target) not in self.absent:
                    self.absent.append((source, target))
                elif present and (source, target) in self.absent:
                    self.returned.add((source, target))
            case EdgePruned(source, target):
                self.absent.append((source, target))
            case NodeAdded():
                self.nodes_added += 1
            case EdgeAdded():
                self.edges_added += 1
            case _:
                pass


class Captions:
    """What was told so far, and how each thing is told."""

    def __init__(self, door_names: Sequence[str]) -> None:
        """Call the doors by these names."""
        self._names = door_names
        self.told: list[str] = []
        self._told_once: set[str] = set()

    def tell(self, text: str) -> None:
        """Say something."""
        self.told.append(text)

    def no_story(self) -> None:
        """Nothing can be told here."""
        self.tell(NO_STORY)

    def way_is_shown(self, moved_away: str | None, room: str) -> None:
        """The robot is led along a way that its map lacks."""
        if moved_away is None:
            self.tell(f"There is a way through the {room} that the map does not know. The robot is led along it once.")
            return
        thing = moved_away.removeprefix(OWN_PREFIX).rpartition("-")[0].replace("-", " ")
        self.tell(f"Somebody moved the {thing} out of the {room}: now there is a way. The robot is led along it once.")

    def sets_out(self, stage: Stage) -> None:
        """The robot drives by its map."""
        other = "The map knows another way, too." if stage.has_way_round else "The map knows no other way."
        self.tell(f"Now it drives by itself, to node {stage.goal}, through {self._door(stage.door)}. {other}")

    def door_closes(self, door: int) -> None:
        """Somebody closes it."""
        self.tell(f"Somebody closes {self._door(door)}. The robot does not know it yet.")

    def plan_turns(self, nodes: int) -> None:
        """A plan leads round the door."""
        self._tell_once(f"The plan turns: the robot goes round by the other way, {nodes} nodes long.")

    def is_called_back(self) -> None:
        """There is no other way."""
        self.tell("The map knows no other way, so the robot is called back.")

    def no_door_on_the_way(self) -> None:
        """It drove another way than was thought."""
        self.tell("The robot found a way that does not lead through the door. Try again from another place.")

    def tries_again_unseeing(self) -> None:
        """The robot was stopped and did not find out by what."""
        self.tell(
            "It did not see what is in the way, so the map learns nothing from it. It is put back and tries again."
        )

    def ended(self, outcome: Outcome) -> None:
        """The robot came to the end of its way."""
        if outcome is not Outcome.CANCELLED:
            self.tell("The robot arrived." if outcome is Outcome.ARRIVED else f"The robot gives up ({outcome}).")

    def door_opens(self, door: int, wait_s: float) -> None:
        """The door is open again, and time goes by."""
        name = self._door(door)
        self.tell(
            f"{name[:1].upper()}{name[1:]} is opened, and nobody tells the robot. {_duration(wait_s)} later it stands "
            "where it began, and sets out again."
        )

    def tries_again(self) -> None:
        """A plan leads through the door again."""
        self._tell_once("After so long the map thinks that the door may be open: the plan tries it again.")

    def tell_of_map(self, facts: StoryFacts, absent: int, nodes_added: int, returned: int) -> None:
        """Tell what changed in the map since there were so many."""
        if nodes_added < _SEVERAL <= facts.nodes_added:
            self.tell("New nodes appear in the map, in green: places that it did not know.")
        if not absent and facts.absent:
            self.tell(
                "The robot sees the closed door. The edges through it fade, in magenta: absent now, not forgotten."
            )
        if not returned and facts.returned:
            self.tell("The door is open. The edges through it return.")

    def summary(self, facts: StoryFacts) -> None:
        """Say what was learnt."""
        self.tell(
            f"Learnt: {len(facts.absent)} edges were absent for a while, {len(facts.returned)} of them are back; "
            f"{facts.nodes_added} nodes and {facts.edges_added} edges are new."
        )

    def _door(self, door: int) -> str:
        return f"the door {self._names[door]}"

    def _tell_once(self, text: str) -> None:
        about = text[:20]
        if about not in self._told_once:
            self._told_once.add(about)
            self.tell(text)


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 3600 else f"{seconds / 3600:.0f} hours"


class _Phase(Enum):
    BEGINNING = auto()
    LEADING = auto()
    """The robot is shown a way."""
    GOING = auto()
    """It drives by its map, and a door closes."""
    RETURNING = auto()
    """The door is open again, and it comes that way once more."""
    OVER = auto()


class DoorStory:
    """One story, from its beginning to its end."""

    def __init__(self, story_map: StoryMap, door_names: Sequence[str]) -> None:
        """Play in a map whose doors a person calls by these names."""
        self._map = story_map
        self._captions = Captions(door_names)
        self.facts = StoryFacts()
        self._phase = _Phase.BEGINNING
        self._steps: deque[StoryStep] = deque()
        """What is done next, each as soon as the robot is idle."""
        self._stage: Stage | None = None
        self._is_closed = self._is_called_back = False
        self._plan: tuple[NodeId, ...] = ()
        self._steps_at_door = self._steps_beyond_door = 0
        self._tries = 0
        self._goals: list[NodeId] = []
        """Where to go once the door is open again."""

    @property
    def captions(self) -> Sequence[str]:
        """What was told so far."""
        return self._captions.told

    @property
    def is_over(self) -> bool:
        """Whether there is nothing more to do."""
        return self._phase is _Phase.OVER

    @property
    def stage(self) -> Stage | None:
        """Where it plays; None before it is known, and where it cannot."""
        return self._stage

    def take(self, event: Event) -> None:
        """Look at what happened."""
        before = len(self.facts.absent), self.facts.nodes_added, len(self.facts.returned)
        self.facts.take(event)
        match event:
            case Planned(nodes=nodes) if nodes and self._phase in (_Phase.GOING, _Phase.RETURNING):
                self._plan = nodes
                self._tell_of_plan()
            case QueryEnded(outcome=outcome) if self._phase in (_Phase.GOING, _Phase.RETURNING):
                self._go_on_after(outcome)
            case _ if self._phase is not _Phase.OVER:
                self._captions.tell_of_map(self.facts, *before)
            case _:
                pass

    def next_step(self, *, is_idle: bool) -> StoryStep | None:
        """Return what to do now, if anything; `is_idle` says that the robot stands and waits for a goal."""
        if self._phase is _Phase.BEGINNING and is_idle:
            self._begin()
        if self._phase is _Phase.LEADING and is_idle and not self._steps:
            self._set_out()
        if self._steps and is_idle:
            return self._steps.popleft()
        stage = self._stage
        if stage is None or is_idle or self._is_called_back:
            return None
        if self._phase is _Phase.GOING and not self._is_closed and self._map.passes(self._plan, stage.door):
            self._is_closed = True
            self._captions.door_closes(stage.door)
            return Change(DoorMoved(stage.door, is_open=False))
        if self._phase is _Phase.GOING and self.facts.absent and not stage.has_way_round:
            return self._wait_a_little()
        if self._phase is _Phase.RETURNING and self.facts.returned:
            return self._drive_on_a_little()
        return None

    def stop(self, why: str) -> StoryStep | None:
        """End it early and say why; returns what to do yet."""
        self._phase = _Phase.OVER
        self._steps.clear()
        self._captions.tell(why)
        if self._stage is None or not self._is_closed:
            return None
        self._is_closed = False
        return Change(DoorMoved(self._stage.door, is_open=True))

    def _begin(self) -> None:
        self._stage = self._map.stage()
        if self._stage is not None and self._stage.has_way_round:
            self._send(self._stage)
        elif (unknown := self._map.unknown_way()) is not None:
            self._phase = _Phase.LEADING
            self._captions.way_is_shown(unknown.moved_away, self._map.room(unknown.path[len(unknown.path) // 2]))
            if unknown.moved_away is not None:
                self._steps.append(Change(ThingRemoved(unknown.moved_away)))
            self._steps += [Carry(self._map.pose(self._map.start_of(unknown))), Lead(unknown.path)]
        elif (elsewhere := self._map.stage_anywhere() or self._stage) is not None:
            self._steps.append(Carry(self._map.pose(elsewhere.start)))
            self._stage = elsewhere
            self._send(elsewhere)
        else:
            self._phase = _Phase.OVER
            self._captions.no_story()

    def _set_out(self) -> None:
        """Let the robot drive by itself where it was led."""
        unknown = self._map.unknown_way_found
        assert unknown is not None
        stage = self._map.stage_by(unknown) or self._map.stage()
        if stage is None:
            self._phase = _Phase.OVER
            self._captions.no_story()
            return
        self._stage = stage
        self._steps.append(Carry(self._map.pose(stage.start)))
        self._send(stage)

    def _send(self, stage: Stage) -> None:
        self._phase = _Phase.GOING
        self._captions.sets_out(stage)
        self._steps.append(GoTo(stage.goal))

    def _wait_a_little(self) -> StoryStep | None:
        """Let the robot look at the closed door for a while; then there is nothing left for it to do."""
        self._steps_at_door += 1
        if self._steps_at_door < STEPS_AT_DOOR:
            return None
        self._is_called_back = True
        self._captions.is_called_back()
        return CallBack()

    def _drive_on_a_little(self) -> StoryStep | None:
        """Let more edges return; then the story is told, though the robot has not arrived."""
        self._steps_beyond_door += 1
        if self._steps_beyond_door < STEPS_BEYOND_DOOR and not self.facts.are_all_back:
            return None
        self._is_called_back = True
        return CallBack()

    def _tell_of_plan(self) -> None:
        if self._stage is None:
            return
        through = self._map.passes(self._plan, self._stage.door)
        if self._phase is _Phase.GOING and self._is_closed and not through:
            self.facts.rerouted = True
            self._captions.plan_turns(len(self._plan))
        if self._phase is _Phase.RETURNING and through:
            self._captions.tries_again()

    def _go_on_after(self, outcome: Outcome) -> None:
        """Go on after the end of a query; one that somebody else cancelled stops the story."""
        stage = self._stage
        called_back = self._is_called_back
        assert stage is not None
        self._is_called_back = False
        if outcome is Outcome.CANCELLED and not called_back:
            return
        if self._phase is _Phase.RETURNING:
            self._end_or_try_again(stage)
        elif not self._is_closed:
            self._phase = _Phase.OVER
            self._captions.no_door_on_the_way()
        elif not self.facts.absent and not called_back and self._tries < MOST_TRIES:
            self._tries += 1
            self._captions.tries_again_unseeing()
            self._steps += [Carry(self._map.pose(stage.start)), GoTo(stage.goal)]
        else:
            self._captions.ended(outcome)
            self._reopen(stage)

    def _reopen(self, stage: Stage) -> None:
        """Open the door, let time pass, and send the robot that way again."""
        self._phase = _Phase.RETURNING
        self._is_closed = False
        wait_s = self._map.wait_s(stage)
        self._captions.door_opens(stage.door, wait_s)
        self._steps += [Change(DoorMoved(stage.door, is_open=True)), Change(TimePassed(wait_s))]
        # A map has several edges through a door; the shortest way may lead along one that was never seen blocked.
        self._goals = [stage.goal, *(list(self.facts.absent[0]) if self.facts.absent else [])]
        self._try(stage)

    def _try(self, stage: Stage) -> None:
        self._steps += [Carry(self._map.pose(stage.start)), GoTo(self._goals.pop(0))]

    def _end_or_try_again(self, stage: Stage) -> None:
        if not self.facts.returned and self._goals:
            self._try(stage)
            return
        self._phase = _Phase.OVER
        self._captions.summary(self.facts)
