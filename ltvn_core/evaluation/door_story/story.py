"""The steps of the story and its captions. Drives nothing; the page and a headless run play it.

The robot learns another way, meets a wrong edge, and then a door on its way that closes and later opens again. The
player passes every event to `take`, calls `next_step` at each control step, and carries out the result. Each caption is
one plain sentence about the state of the map or the world at that moment. It stands for `READ_S`; until then the robot
waits before anything happens that the next caption is about.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.door_story.story_map import (
    DOOR,
    GOAL,
    LED_ALONG,
    LED_FROM,
    START,
    TABLE,
    WRONG_EDGE,
    StoryMap,
)
from ltvn_core.graph.deltas import Cause, EdgeAdded, EdgePruned, GraphDelta, NodeAdded, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, Planned, QueryEnded
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds import DoorMoved, ThingRemoved, TimePassed, WorldChange

STORY_MAINTENANCE = "persistent"
"""Name of the maintenance in a story."""
READ_S = 4.5
"""Least time for which a caption stands before the next one, in seconds."""
_SEVERAL = 3
"""Number of new nodes at which a caption first mentions them."""
SETTLED_STEPS = 20
"""Number of control steps without another edge seen open after which the caption counts those that returned."""
_LEAST_WAIT_S = 600.0


@dataclass(frozen=True, slots=True)
class GoTo:
    """Drive to a node now."""

    node: NodeId


@dataclass(frozen=True, slots=True)
class Change:
    """Change the world now."""

    change: WorldChange


@dataclass(frozen=True, slots=True)
class Edit:
    """Change the map now, as a person may."""

    delta: GraphDelta


@dataclass(frozen=True, slots=True)
class Wait:
    """Let the robot stand for a control step, because a caption is being read."""


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


StoryStep: TypeAlias = GoTo | Change | Edit | Wait | Carry | Lead
_Steps: TypeAlias = Iterator[StoryStep | None]
"""Action at each control step; None for no action."""


@dataclass
class StoryFacts:
    """Facts collected during the story."""

    absent: list[EdgeKey] = field(default_factory=list)
    """Edges that were seen blocked, in this order."""
    returned: set[EdgeKey] = field(default_factory=set)
    """Edges of `absent` that were seen open last."""
    pruned: list[EdgeKey] = field(default_factory=list)
    nodes_added: int = 0
    edges_added: int = 0
    rerouted: bool = False
    """Whether the robot changed its plan to another path, without the closed door."""

    def take(self, event: Event) -> None:
        """Count one event."""
        match event:
            case GraphChanged(delta=PresenceObserved(source, target, present)):
                edge = (source, target)
                if not present:
                    self.returned.discard(edge)
                    self.absent += [edge] if edge not in self.absent else []
                elif edge in self.absent:
                    self.returned.add(edge)
            case GraphChanged(delta=EdgePruned(source, target)):
                self.pruned.append((source, target))
            case GraphChanged(delta=NodeAdded()):
                self.nodes_added += 1
            case GraphChanged(delta=EdgeAdded(cause=cause)):
                self.edges_added += cause is not Cause.HAND  # The wrong edge was not learnt.
            case _:
                pass

    @property
    def still_absent(self) -> set[EdgeKey]:
        """The edges that were seen blocked last."""
        return set(self.absent) - self.returned


class DoorStory:
    """One story, from its beginning to its end."""

    def __init__(self, story_map: StoryMap, door_names: Sequence[str], clock: Callable[[], float]) -> None:
        """Create a story in the shipped map, see `why_no_story`.

        `door_names` are the names of its doors in captions; `clock` measures in seconds for how long a caption stands.
        """
        self._map = story_map
        self._door = f"the door {door_names[DOOR]}"
        self._clock = clock
        self.captions: list[str] = []
        """Captions so far."""
        self._queue: deque[str] = deque()
        """Captions that wait until the one before was read."""
        self._told_s = float("-inf")
        self.facts = StoryFacts()
        self.is_over = False
        """Whether the story has ended."""
        self._script = self._play()
        self._is_idle = self._is_closed = False
        self._blocked: set[EdgeKey] | None = None
        """Edges that were absent when the door was opened again; None before."""
        self._plan: tuple[NodeId, ...] = ()
        self._outcome: Outcome | None = None
        """Outcome of the last query."""

    def take(self, event: Event) -> None:
        """Process an event."""
        self.facts.take(event)
        if self.is_over:
            return
        self._tell_of_map()
        if isinstance(event, Planned) and event.nodes:
            self._plan = event.nodes
            self._tell_of_plan()
        elif isinstance(event, QueryEnded):
            self._outcome = event.outcome

    def next_step(self, *, is_idle: bool) -> StoryStep | None:
        """Return the next action, if any; `is_idle` is True while the robot waits for a goal."""
        self._is_idle = is_idle
        if self.is_over:
            return None
        self._flush()
        if self._queue:
            return Wait()
        try:
            return next(self._script)
        except StopIteration:
            self.is_over = True
            return None

    def stop(self, why: str) -> Sequence[StoryStep]:
        """End the story early with a reason; return the last actions, which open the door again."""
        self.is_over = True
        self._queue.clear()
        self.captions.append(why)
        is_closed, self._is_closed = self._is_closed, False
        return (Change(DoorMoved(DOOR, is_open=True)),) if is_closed else ()

    def leftovers(self) -> Sequence[GraphDelta]:
        """Return the changes that free the map of the wrong edge, which belongs to the story alone."""
        is_left = self.is_over and WRONG_EDGE in self._map.graph.edges
        return (EdgePruned(*WRONG_EDGE, Cause.HAND),) if is_left else ()

    def _play(self) -> _Steps:
        yield from self._until_idle()
        if DOOR in self._map.world.state.closed_doors:
            yield Change(DoorMoved(DOOR, is_open=True))
        yield from self._learn_other_way()
        yield from self._prepare()
        yield from self._query(self._close_door)
        if self._is_closed and self.facts.absent:
            yield from self._find_open_door()
            return
        yield from self._tell("The story ends here: the robot found a path that does not lead through the door.")
        if self._is_closed:
            self._is_closed = False
            yield Change(DoorMoved(DOOR, is_open=True))

    def _learn_other_way(self) -> _Steps:
        """Drive the robot along the way that its map lacks."""
        if TABLE not in self._map.world.state.missing:
            yield from self._tell("Somebody moves the high table out of the kitchen: there is another way now.")
            yield from self._when_idle(Change(ThingRemoved(TABLE)))
        if self._map.knows_other_way:
            return
        yield from self._tell("The map lacks the way through the kitchen. The robot is driven along it once.")
        yield from self._when_idle(Carry(self._map.pose(LED_FROM)))
        yield from self._when_idle(Lead(LED_ALONG))
        yield from self._until_idle()

    def _prepare(self) -> _Steps:
        """Put the robot to its start, with a map that plans through the door, but for one wrong edge."""
        if wait_s := self._map.wait_s():
            yield from self._tell(f"{_duration(wait_s)} pass, until the map trusts the door again.")
            yield from self._when_idle(Change(TimePassed(wait_s)))
        yield from self._tell(
            f"The map also gets a wrong edge, which failed twice: it takes what lies ahead for node {GOAL}."
        )
        yield from self._when_idle(Carry(self._map.pose(START)))
        if WRONG_EDGE not in self._map.graph.edges:
            yield from self._when_idle(Edit(EdgeAdded(self._map.wrong_edge(), Cause.HAND)))
        yield from self._tell(f"Now the robot drives by itself to node {GOAL}, and first tries the wrong edge.")

    def _close_door(self) -> StoryStep | None:
        """Close the door when a plan leads through it, once the captions before that were read."""
        if self._is_closed or not self._map.passes(self._plan):
            return None
        if not self._was_read:
            return Wait()
        self._is_closed = True
        self._say(f"Somebody closes {self._door}. The robot does not know it yet.")
        return Change(DoorMoved(DOOR, is_open=False))

    def _find_open_door(self) -> _Steps:
        """Open the door, let time pass, and send the robot that way again."""
        yield from self._tell(self._arrival())
        yield from self._tell(f"{self._door[:1].upper()}{self._door[1:]} is opened. The robot does not know it yet.")
        yield from self._when_idle(Change(DoorMoved(DOOR, is_open=True)))
        self._is_closed = False
        self._blocked = self.facts.still_absent
        wait_s = self._map.wait_s(at_least_s=_LEAST_WAIT_S)
        yield from self._tell(f"{_duration(wait_s)} later the robot starts again from the same place.")
        yield from self._when_idle(Change(TimePassed(wait_s)))
        yield from self._when_idle(Carry(self._map.pose(START)))
        yield from self._query(self._count_returned())
        facts = self.facts
        yield from self._tell(
            f"Learnt: {len(facts.absent)} edges were absent for a while, {len(facts.returned)} of them are back, "
            f"{len(facts.pruned)} pruned; {facts.nodes_added} nodes and {facts.edges_added} edges are new."
        )
        yield from self._tell(f"The story is over. {self._arrival()}")

    def _arrival(self) -> str:
        is_there = self._outcome is Outcome.ARRIVED
        return "The robot arrived at its goal." if is_there else f"The robot gave up ({self._outcome})."

    def _count_returned(self) -> Callable[[], StoryStep | None]:
        """Return what tells of the edges that returned, as soon as no further one does."""
        counted, steps = 0, 0

        def look() -> StoryStep | None:
            nonlocal counted, steps
            before, counted = counted, len(self.facts.returned)
            steps = steps + 1 if counted == before else 0
            if steps >= SETTLED_STEPS:
                self._tell_of_return()
            return None

        return look

    def _tell_of_return(self) -> None:
        """Tell once how many of the edges that were absent behind the closed door are back, and how many are not."""
        assert self._blocked is not None
        back, left = self._blocked & self.facts.returned, self._blocked - self.facts.returned
        if not self._map.through_door(sorted(back)) or any("edges return" in text for text in self.captions):
            return
        rest = f" {len(left)} that it has not looked at again are still absent." if left else ""
        self._say(f"The robot sees that the door is open: {len(back)} edges return.{rest}")

    def _query(self, meanwhile: Callable[[], StoryStep | None]) -> _Steps:
        """Send the robot to the goal, and yield the action at each control step on the way."""
        self._outcome, self._plan = None, ()
        yield from self._when_idle(GoTo(GOAL))
        while self._outcome is None:
            yield None if self._is_idle else meanwhile()
        if self._blocked is not None:
            self._tell_of_return()

    def _when_idle(self, step: StoryStep) -> _Steps:
        yield from self._until_idle()
        yield step

    def _until_idle(self) -> _Steps:
        while not self._is_idle:
            yield None

    def _tell_of_plan(self) -> None:
        through = self._map.passes(self._plan)
        if self._blocked is not None and through:
            self._say_once("The map thinks that the door may be open by now: the plan leads through it again.")
        if self._is_closed and self.facts.absent and not through and not self.facts.rerouted:
            self.facts.rerouted = True
            self._say(f"The plan changes: the robot takes the other path, {len(self._plan)} nodes long.")

    def _tell_of_map(self) -> None:
        if self.facts.nodes_added >= _SEVERAL:
            self._say_once("New nodes appear in the map, in green: places that it did not know.")
        if WRONG_EDGE in self.facts.pruned:
            self._say_once("The robot did not come to its goal by the wrong edge: the map prunes it, for good.")
        if self._is_closed and self._map.through_door(sorted(self.facts.still_absent)):
            self._say_once(
                "The robot sees the closed door. The edges through it fade, in magenta: absent now, not forgotten."
            )

    def _tell(self, text: str) -> _Steps:
        """Wait until all captions so far were read, then tell the next one."""
        while not self._was_read:
            yield Wait()
        self._say(text)

    def _say(self, text: str) -> None:
        self._queue.append(text)
        self._flush()

    def _say_once(self, text: str) -> None:
        if text not in self.captions and text not in self._queue:
            self._say(text)

    def _flush(self) -> None:
        """Tell the next caption in the queue if the one before was read."""
        if self._queue and self._was_read:
            self.captions.append(self._queue.popleft())
            self._told_s = self._clock()

    @property
    def _was_read(self) -> bool:
        return self._clock() - self._told_s >= READ_S


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 3600 else f"{seconds / 3600:.0f} hours"
