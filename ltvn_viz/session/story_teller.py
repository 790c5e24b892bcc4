"""“Watch it learn” in the page: plays the story of a door that closes and opens again, with captions.

Owns the conversion of the story's steps to commands, and the app's maintenance and pace during the story. The story
itself is in `ltvn_core.evaluation.door_story`. For the session's thread only.
"""

from collections.abc import Sequence
from typing import assert_never

from ltvn_core.errors import LtvnError
from ltvn_core.evaluation.door_story.story import (
    STORY_MAINTENANCE,
    Carry,
    Change,
    DoorStory,
    Edit,
    GoTo,
    Lead,
    StoryStep,
    Wait,
)
from ltvn_core.evaluation.door_story.story_map import StoryMap
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Note, QueryStarted
from ltvn_core.simulation.scene import door_names
from ltvn_core.simulation.scripted_tour import LED_M_S, PathFollower
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_viz.session.changeable_world import ChangeableWorld
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.live_run import TICK_S, LiveRun
from ltvn_viz.wishes import commands as c

PACE = 3
"""Largest speed of the robot's time as a factor of real time."""


class StoryTeller:
    """One story in the page."""

    def __init__(self, live: LiveRun, live_map: LiveMap, world: ChangeableWorld) -> None:
        """Start a story; until it ends, the map is maintained with presence."""
        self._live = live
        self._live_map = live_map
        self._world = world
        self._system_before = live_map.system
        live_map.use_system(with_maintenance(live_map.system, STORY_MAINTENANCE))
        live.pace = PACE
        self._ticks = 0
        story_map = StoryMap(live_map.graph, live_map.system, world.world, live_map.keyframes.observation)
        # A caption is read in real time, of which a tick of the session is never less.
        self.story = DoorStory(story_map, door_names(world.world.base), lambda: self._ticks * TICK_S)
        self._graph = live_map.graph
        self._read = len(live.timeline.events)
        self._told = 0
        self._led: PathFollower | None = None
        self._is_closed = False
        self.is_waiting = False
        """Whether the robot stands until a caption was read."""
        self.query: int | None = None
        """The last query that the story started."""

    @property
    def is_over(self) -> bool:
        """Whether the story has ended."""
        return self.story.is_over

    @property
    def captions(self) -> Sequence[str]:
        """Return the captions so far."""
        return tuple(self.story.captions)

    def lead(self) -> bool:
        """Drive the robot as the story requires; returns whether the story drives it. Called once in each tick."""
        self._ticks += 1
        if self._led is None:
            return False
        robot = self._live.robot
        twist = None if robot.state().bumper_pressed else self._led.twist(robot.drawn_pose)
        if twist is not None:
            robot.drive(twist)
            self._read_events()
            self._tell()
            return True
        self._led = None
        robot.stop()
        return False

    def tick(self, *, is_idle: bool) -> c.Command | None:
        """Continue; returns the next commands. The map must not change during the call."""
        self._read_events()
        command = None
        step = None
        try:
            step = None if self.is_over else self.story.next_step(is_idle=is_idle)
            command = self._carry_out(step)
        except LtvnError as error:
            self.stop(f"The story ends here. {error}")
        if self._graph is not self._live_map.graph and not self.is_over:
            self.stop("The map was replaced, so the story ends here.")
        self.is_waiting = isinstance(step, Wait)
        self._tell()
        return command

    def stand(self) -> None:
        """Let robot time pass by a tick while the robot stands and a caption is read."""
        self._live.robot.stop()
        self._live.let_pass(TICK_S)

    def leftovers(self) -> Sequence[GraphDelta]:
        """Return what is still to be changed in the map after the story's end."""
        return self.story.leftovers() if self._graph is self._live_map.graph else ()

    def close(self) -> None:
        """Restore the map's maintenance and the pace of time from before the story."""
        if not self._is_closed:
            self._is_closed = True
            self._live_map.use_system(self._system_before)
            self._live.pace = 1

    def stop(self, why: str) -> None:
        """End the story early, with the door open; `close` restores the rest when nothing uses the map any more."""
        self._led = None
        self.is_waiting = False
        for step in self.story.stop(why):
            self._carry_out(step)
        self._tell()

    def _carry_out(self, step: StoryStep | None) -> c.Command | None:
        match step:
            case None | Wait():
                return None
            case GoTo(node):
                return c.Ask(c.Action.GOAL, node)
            case Change(change):
                self._world.change(change)
                return None
            case Edit(delta):
                return c.EditMap((delta,))
            case Carry(pose):
                self._world.carry(pose)
                return None
            case Lead(path):
                self._led = PathFollower(path, speed_m_s=LED_M_S)
                return None
            case _:
                assert_never(step)

    def _read_events(self) -> None:
        events = self._live.timeline.events
        for stamped in events[self._read :]:
            self.story.take(stamped.event)
            if isinstance(stamped.event, QueryStarted):
                self.query = stamped.event.query
        self._read = len(events)

    def _tell(self) -> None:
        """Store a caption with the run; the page shows it only below the scene."""
        for text in self.captions[self._told :]:
            self._told += 1
            self._live.emit(Note(text))
