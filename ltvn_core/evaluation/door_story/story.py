"""The steps of the story and its captions. Drives nothing; the page and a headless run play it.

A door on the planned path closes, and later it opens again. The player passes every event to `take`, calls `next_step`
at each control step, and carries out the result. Each caption is one plain sentence.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.door_story.story_map import Stage, StoryMap
from ltvn_core.evaluation.door_story.unknown_way import UnknownWay
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds import OWN_PREFIX, DoorMoved, ThingRemoved, TimePassed, WorldChange

NO_STORY = "No path in this map leads from here through a door. Map more rooms, and try again from one of them."
STORY_MAINTENANCE = "persistent"
"""Name of the maintenance in a story."""
_ENDS: dict[Outcome | None, str] = {
    Outcome.ARRIVED: "the robot arrived",
    Outcome.CANCELLED: "the robot is called back, because the demonstration is complete",
}
_SEVERAL = 3
"""Number of new nodes at which a caption first mentions them."""
MOST_TRIES = 2
"""Maximum number of further tries if the robot took another path without seeing the closed door."""
STEPS_AT_DOOR, STEPS_BEYOND_DOOR = 80, 250
"""Numbers of control steps after which the robot is called back: at a closed door, and beyond an open door."""


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
    """End the running query now."""


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """Move the robot to another place now."""

    pose: Pose
    """(3,) in the world frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """Drive the robot by hand, and extend the map from its images."""

    path: NDArray[np.float64]
    """(M, 2) x and y in metres."""


StoryStep: TypeAlias = GoTo | Change | CallBack | Carry | Lead
_Steps: TypeAlias = Iterator[StoryStep | None]
"""Action at each control step; None for no action."""


@dataclass
class StoryFacts:
    """Facts collected during the story."""

    absent: list[EdgeKey] = field(default_factory=list)
    """Edges that were seen blocked, or pruned, in this order."""
    returned: set[EdgeKey] = field(default_factory=set)
    """Edges of `absent` that were later seen open."""
    nodes_added: int = 0
    edges_added: int = 0
    rerouted: bool = False
    """Whether the robot changed its plan to another path, without the closed door."""

    def take(self, event: Event) -> None:
        """Count one event."""
        match event:
            case GraphChanged(delta=PresenceObserved(source, target, present)):
                if (source, target) not in self.absent:
                    self.absent += [] if present else [(source, target)]
                elif present:
                    self.returned.add((source, target))
            case GraphChanged(delta=EdgePruned(source, target)):
                self.absent.append((source, target))
            case GraphChanged(delta=NodeAdded()):
                self.nodes_added += 1
            case GraphChanged(delta=EdgeAdded()):
                self.edges_added += 1
            case _:
                pass


class DoorStory:
    """One story, from its beginning to its end."""

    def __init__(self, story_map: StoryMap, door_names: Sequence[str]) -> None:
        """Create a story in a map; `door_names` are the names of its doors in captions."""
        self._map = story_map
        self._door_names = door_names
        self.captions: list[str] = []
        """Captions so far."""
        self.facts = StoryFacts()
        self.stage: Stage | None = None
        """Place of the story; None before it is known, or if there is none."""
        self.is_over = False
        """Whether the story has ended."""
        self._script = self._play()
        self._is_idle = self._is_closed = self._is_reopened = self._is_called_back = False
        self._plan: tuple[NodeId, ...] = ()
        self._outcome: Outcome | None = None
        """Outcome of the last query."""
        self._steps_near = 0

    def take(self, event: Event) -> None:
        """Process an event; a query that another person cancelled is not continued."""
        self.facts.take(event)
        if self.is_over:
            return
        self._tell_of_map()
        if isinstance(event, Planned) and event.nodes and self.stage is not None:
            self._plan = event.nodes
            self._tell_of_plan(self.stage)
        elif isinstance(event, QueryEnded) and self.stage is not None and self._is_own(event.outcome):
            self._outcome = event.outcome
            self.next_step(is_idle=False)  # Adds the last caption; the next action waits for an idle robot.

    def next_step(self, *, is_idle: bool) -> StoryStep | None:
        """Return the next action, if any; `is_idle` is True while the robot waits for a goal."""
        self._is_idle = is_idle
        try:
            return None if self.is_over else next(self._script)
        except StopIteration:
            self.is_over = True
            return None

    def stop(self, why: str) -> StoryStep | None:
        """End the story early with a reason; return the last action, if any."""
        self.is_over = True
        self.captions.append(why)
        if self.stage is None or not self._is_closed:
            return None
        self._is_closed = False
        return Change(DoorMoved(self.stage.door, is_open=True))

    def _play(self) -> _Steps:
        yield from self._until_idle()
        stage = self._map.stage()
        stands_there = stage is not None and stage.has_way_round
        if not stands_there and (unknown := self._map.unknown_way()) is not None:
            yield from self._lead_along(unknown)
            stage = self._map.stage_by(unknown) or self._map.stage()
        if stage is None:
            self.captions.append(NO_STORY)
            return
        self.stage = stage
        other = "The map has another path, too." if stage.has_way_round else "The map has no other path."
        self.captions.append(f"Now it drives autonomously to node {stage.goal}, through {self._door}. {other}")
        if not stands_there:
            yield from self._when_idle(Carry(self._map.pose(stage.start)))
        yield from self._meet_closed_door(stage)
        if self._is_closed:
            yield from self._find_open_door(stage)

    def _lead_along(self, unknown: UnknownWay) -> _Steps:
        """Drive the robot along a path that its map lacks."""
        room = self._map.room(unknown.path[len(unknown.path) // 2])
        if unknown.moved_away is None:
            self.captions.append(
                f"There is a route through the {room} that the map lacks. The robot is driven along it once."
            )
        else:
            thing = unknown.moved_away.removeprefix(OWN_PREFIX).rpartition("-")[0].replace("-", " ")
            self.captions.append(
                f"Somebody moved the {thing} out of the {room}: now there is a route. The robot is driven along it "
                "once."
            )
            yield from self._when_idle(Change(ThingRemoved(unknown.moved_away)))
        yield from self._when_idle(Carry(self._map.pose(self._map.start_of(unknown))))
        yield from self._when_idle(Lead(unknown.path))
        yield from self._until_idle()

    def _meet_closed_door(self, stage: Stage) -> _Steps:
        """Let the robot drive with its map, and close the door as soon as a plan leads through it."""
        for tries_left in reversed(range(MOST_TRIES + 1)):
            yield from self._query(stage.goal, partial(self._close_or_wait, stage))
            if not self._is_closed:
                self.captions.append(
                    "The robot found a path that does not lead through the door. Try again from another place."
                )
                return
            if self.facts.absent or self._is_called_back or not tries_left:
                break
            self.captions.append(
                "The robot did not see the obstacle, so the map learns nothing. It starts again from the same place."
            )
            yield from self._when_idle(Carry(self._map.pose(stage.start)))
        if self._outcome is Outcome.ARRIVED:
            self.captions.append("The robot arrived.")
        elif self._outcome is not Outcome.CANCELLED:
            self.captions.append(f"The robot gives up ({self._outcome}).")

    def _close_or_wait(self, stage: Stage) -> StoryStep | None:
        """Close the door when a plan leads through it.

        If the map has no other path, the robot may observe the closed door for a while; then it is called back.
        """
        if not self._is_closed and self._map.passes(self._plan, stage.door):
            self._is_closed = True
            self.captions.append(f"Somebody closes {self._door}. The robot does not know it yet.")
            return Change(DoorMoved(stage.door, is_open=False))
        if not self.facts.absent or stage.has_way_round:
            return None
        self._steps_near += 1
        if self._steps_near < STEPS_AT_DOOR:
            return None
        self.captions.append("The map has no other path, so the robot is called back.")
        return self._call_back()

    def _find_open_door(self, stage: Stage) -> _Steps:
        """Open the door, let time pass, and send the robot that way again."""
        wait_s = self._map.wait_s(stage)
        self._is_reopened = True
        self._steps_near = 0
        self.captions.append(
            f"{self._door[:1].upper()}{self._door[1:]} is opened, but the robot does not know it yet. "
            f"{_duration(wait_s)} later it starts again from the same place."
        )
        yield from self._when_idle(Change(DoorMoved(stage.door, is_open=True)))
        self._is_closed = False
        yield from self._when_idle(Change(TimePassed(wait_s)))
        # A map has several edges through a door; the shortest way may lead along one that was never seen blocked.
        for goal in (stage.goal, *(self.facts.absent[0] if self.facts.absent else ())):
            yield from self._when_idle(Carry(self._map.pose(stage.start)))
            yield from self._query(goal, self._drive_on_a_little)
            if self.facts.returned:
                break
        facts = self.facts
        self.captions.append(
            f"Learnt: {len(facts.absent)} edges were absent for a while, {len(facts.returned)} of them are back; "
            f"{facts.nodes_added} nodes and {facts.edges_added} edges are new."
        )
        self.captions.append(f"The story is over: {_ENDS.get(self._outcome, 'the robot stopped on its way')}.")

    def _drive_on_a_little(self) -> StoryStep | None:
        """Let the robot drive on after it saw the door open; call it back if it does not arrive in time."""
        if not self.facts.returned:
            return None
        self._steps_near += 1
        return self._call_back() if self._steps_near >= STEPS_BEYOND_DOOR else None

    def _is_own(self, outcome: Outcome) -> bool:
        """Tell whether a query ended by itself, or because the story called the robot back."""
        return outcome is not Outcome.CANCELLED or self._is_called_back

    def _call_back(self) -> StoryStep:
        self._is_called_back = True
        return CallBack()

    def _query(self, goal: NodeId, meanwhile: Callable[[], StoryStep | None]) -> _Steps:
        """Send the robot to a goal, and yield the action at each control step on the way."""
        self._outcome = None
        self._is_called_back = False
        yield from self._when_idle(GoTo(goal))
        while self._outcome is None:
            yield None if self._is_idle or self._is_called_back else meanwhile()

    def _when_idle(self, step: StoryStep) -> _Steps:
        yield from self._until_idle()
        yield step

    def _until_idle(self) -> _Steps:
        while not self._is_idle:
            yield None

    def _tell_of_plan(self, stage: Stage) -> None:
        through = self._map.passes(self._plan, stage.door)
        if self._is_reopened and through:
            self._tell_once("After this time the map thinks that the door may be open: the plan goes through it again.")
        if self._is_closed and not self._is_reopened and not through and not self.facts.rerouted:
            self.facts.rerouted = True
            self.captions.append(f"The plan changes: the robot takes the other path, {len(self._plan)} nodes long.")

    def _tell_of_map(self) -> None:
        if self.facts.nodes_added >= _SEVERAL:
            self._tell_once("New nodes appear in the map, in green: places that it did not know.")
        if self.facts.absent:
            self._tell_once(
                "The robot sees the closed door. The edges through it fade, in magenta: absent now, not forgotten."
            )
        if self.facts.returned:
            self._tell_once("The door is open. The edges through it return.")

    def _tell_once(self, text: str) -> None:
        if text not in self.captions:
            self.captions.append(text)

    @property
    def _door(self) -> str:
        assert self.stage is not None
        return f"the door {self._door_names[self.stage.door]}"


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 3600 else f"{seconds / 3600:.0f} hours"
