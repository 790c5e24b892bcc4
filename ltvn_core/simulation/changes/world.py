"""A scene that changes over time: applies what a script foretells and what a person does, and tells its followers.

Holds the time of the world, its state, how far its script has come, and the robot that must not be hit. Says where a
change puts something solid. Physics and camera belong to the robot, which
`WorldFollower` lets meet the world as it is now. Recordings and views follow too.
"""

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol, assert_never, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ltvn_core import worlds as w
from ltvn_core.errors import SceneError, WorldError
from ltvn_core.navigation.events import ChangedBy, WorldChanged
from ltvn_core.simulation.body import PERSON_RADIUS_M, SCENE_OBSTACLES, Body
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes, leaf_outline, person_outline
from ltvn_core.simulation.changes.people import People
from ltvn_core.simulation.changes.world_script import (
    MORNING_S,
    STATIC,
    TimedChange,
    WorldScript,
    check_change,
    check_floor,
)
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap, extrude_blocked_cells
from ltvn_core.simulation.rooms import FurniturePiece
from ltvn_core.simulation.scene import Scene
from ltvn_core.types import Pose, Renderer
from ltvn_core.worlds import AS_MADE, PersonMoved, WorldState

log = logging.getLogger(__name__)

Follower = Callable[[Sequence[WorldChanged]], None]
"""Is told what changed, in the thread that changed it; `World.scene` is the scene as it is now."""
_ROOM_M = 0.05
"""Nothing is put nearer than this to a robot or a person."""
_TELL_PEOPLE_S = 0.5
"""Where people walk is told this often."""
_FURNITURE_HEIGHT_M = 1.0


class RobotInside(Protocol):
    """The robot, as far as a world needs it."""

    @property
    def exact_pose(self) -> Pose:
        """Where it is, (3,)."""
        ...

    @property
    def stamp(self) -> float:
        """Seconds on its clock."""
        ...


class World:
    """One scene over time. All methods are for the thread that moves the robot."""

    def __init__(self, scene: Scene, script: WorldScript = STATIC, *, start_s: float = MORNING_S) -> None:
        """Begin at `start_s` seconds after midnight of the first day; what the script says of the time before is so.

        Raises WorldError where the script has a change that the scene cannot carry out.
        """
        self.base = scene
        """The scene as it was made."""
        self.script = script
        self.state: WorldState = AS_MADE
        """What is changed now."""
        self._scenes = ChangedScenes(scene)
        self._followers: list[Follower] = []
        self._body: RobotInside | None = None
        self._radius_m = 0.0
        self._epoch_s = start_s
        self._stamp = 0.0
        self._script = ScriptReader(script)
        self._people = People(script.people, script.seed)
        self._tell_people_s = start_s
        self._told = AS_MADE
        """Where people were when their places were last told."""
        for timed in self._script.due(start_s):
            check_change(timed.change, scene, self.state)
            self.state = self.state.after(timed.change)

    @property
    def scene(self) -> Scene:
        """The scene as it is now."""
        return self._scenes.at(self.state)

    @property
    def stepping_aside(self) -> tuple[str, ...]:
        """Names of the people who make room for the robot at this moment."""
        return self._people.stepping_aside

    @property
    def time_s(self) -> float:
        """Seconds from midnight of the world's first day."""
        return self._epoch_s + self._stamp

    def follow(self, follower: Follower) -> None:
        """Tell somebody about every change from now on."""
        self._followers.append(follower)

    def unfollow(self, follower: Follower) -> None:
        """Tell somebody no more."""
        self._followers = [each for each in self._followers if each != follower]

    def enter(self, body: RobotInside, radius_m: float) -> None:
        """Let a robot in: nothing will be put onto it, and its clock moves the world's. It replaces one before."""
        self._epoch_s = self.time_s - body.stamp
        self._stamp = body.stamp
        self._body = body
        self._radius_m = radius_m
        self.make_room(body.exact_pose)

    def make_room(self, pose: Pose) -> None:
        """Let people who stand where the robot is put, at a pose (3,), be somewhere else."""
        self._people.send_away_from(pose)
        self._move_people()

    def leave(self, body: RobotInside) -> None:
        """Let a robot out; time stands still until another one comes."""
        if self._body is body:
            self._body = None

    def apply(self, change: w.WorldChange, by: ChangedBy = ChangedBy.HAND) -> None:
        """Change the world now, or let time pass.

        Raises WorldError for what cannot be: no such door, nothing to take away, something on top of the robot.
        """
        check_change(change, self.base, self.state)
        if isinstance(change, w.TimePassed):
            self.skip(change.duration_s)
            return
        if isinstance(change, w.ThingPlaced):
            check_floor(change, self._scenes.at(self.state.after(w.ThingRemoved(change.thing))))
        self._change([change], by)

    def undo_to(self, before: WorldState) -> None:
        """Make the world what it was before, as by hand, but for people.

        Raises WorldError where somebody stands in the way.
        """
        self._change(self.state.changes_to(replace(before, people=self.state.people)), ChangedBy.HAND)

    def advance_to(self, stamp: float) -> None:
        """Let time pass until `stamp` on the robot's clock, and carry out what the script says."""
        duration_s, self._stamp = stamp - self._stamp, stamp
        self._tell([*self._scripted(), *self._walked(duration_s)])

    def skip(self, duration_s: float) -> None:
        """Let time pass in which the robot's clock stands still; it costs no more than the changes that it brings."""
        passed = w.TimePassed(duration_s)
        check_change(passed, self.base, self.state)
        self._epoch_s += duration_s
        self._people.scatter()
        self._move_people()
        events = [self._carry_out(passed, ChangedBy.HAND, self.time_s), *self._scripted()]
        self._tell([*events, *self._walked(0.0)])

    def reachable(self, start: Pose, goals: Pose) -> NDArray[np.bool_]:
        """Return which of the goals (N, 3) a robot at a pose (3,) can get to as the world is now, (N,)."""
        return np.isfinite(self.scene.clearance.path_lengths(start, np.asarray(goals)[:, :2]))

    def events(self) -> list[WorldChanged]:
        """Return the events with which a recording begins: what time it is and what the world is like.

        None for a scene as it was made in which nothing changes by itself.
        """
        if self.state == AS_MADE and self.script.is_static:
            return []
        changes = w.TimePassed(0.0), *AS_MADE.changes_to(self.state)
        return [WorldChanged(each, ChangedBy.SCRIPT, self.time_s, outline_of(each, self.base)) for each in changes]

    def _change(self, changes: Sequence[w.WorldChange], by: ChangedBy) -> None:
        for change in changes:
            if (why := self._in_the_way(change)) is not None:
                raise WorldError(why)
            self._script.forget(change)
        self._tell([self._carry_out(change, by, self.time_s) for change in changes])

    def _scripted(self) -> Iterator[WorldChanged]:
        """Carry out what the script says, each change as soon as nobody stands in its way."""
        for timed in self._script.due(self.time_s):
            try:
                check_change(timed.change, self.base, self.state)
            except WorldError as no_more:  # A person may have changed it before.
                log.debug("The script's change cannot be any more: %s", no_more)
                continue
            if self._in_the_way(timed.change) is None:
                yield self._carry_out(timed.change, ChangedBy.SCRIPT, timed.at_s)
            else:
                self._script.put_off(timed.change)

    def _walked(self, duration_s: float) -> list[WorldChanged]:
        """Let people walk. Their state changes at each step, but only a few times a second anybody is told."""
        if not self.script.people:
            return []
        clearance = self.scene.clearance
        pose = None if self._body is None else self._body.exact_pose
        self._people.come_and_go(self.time_s, clearance, pose)
        self._people.walk(duration_s, clearance, None if pose is None else (pose[0], pose[1], self._radius_m))
        self._move_people()
        if self.time_s < self._tell_people_s:
            return []
        self._tell_people_s = self.time_s + _TELL_PEOPLE_S
        before, self._told = self._told, replace(self._told, people=self.state.people)
        changes = before.changes_to(self._told)
        return [WorldChanged(each, ChangedBy.SCRIPT, self.time_s, outline_of(each, self.base)) for each in changes]

    def _move_people(self) -> None:
        people = self._people.among(self.state.people)
        if people != self.state.people:
            self.state = replace(self.state, people=people)

    def _in_the_way(self, change: w.WorldChange) -> str | None:
        """Return why a change cannot be while somebody stands where something would come; None where it can."""
        outline = outline_of(change, self.base)
        if outline is None:
            return None
        if self._body is not None:
            x, y, _ = self._body.exact_pose
            if distance_m(outline, x, y) < self._radius_m + _ROOM_M:
                return f"This cannot be now ({w.change_text(change)}): the robot stands there. Drive it away first."
        for person in self.state.people:
            x, y, _ = person.pose
            if not isinstance(change, w.PersonMoved) and distance_m(outline, x, y) < PERSON_RADIUS_M + _ROOM_M:
                return f"This cannot be now ({w.change_text(change)}): {person.person} stands there. Wait a little."
        return None

    def _carry_out(self, change: w.WorldChange, by: ChangedBy, at_s: float) -> WorldChanged:
        self.state = self.state.after(change)
        return WorldChanged(change, by, at_s, outline_of(change, self.base))

    def _tell(self, events: Sequence[WorldChanged]) -> None:
        if events:
            for follower in tuple(self._followers):
                follower(events)


class ScriptReader:
    """One script, and how far it has come."""

    def __init__(self, script: WorldScript) -> None:
        """Begin before the first change."""
        self._script = script
        self._next = 0
        self._waiting: dict[str, w.WorldChange] = {}
        """What was put off, by what it is about."""

    def due(self, time_s: float) -> Iterator[TimedChange]:
        """Yield what was put off, once more, and then what the script says until now; each may be put off again."""
        waiting, self._waiting = self._waiting, {}
        for change in waiting.values():
            yield TimedChange(time_s, change)
        changes = self._script.changes
        while self._next < len(changes) and changes[self._next].at_s <= time_s:
            self._next += 1
            timed = changes[self._next - 1]
            self.forget(timed.change)
            yield timed

    def put_off(self, change: w.WorldChange) -> None:
        """Yield a change again the next time."""
        self._waiting[w.subject(change)] = change

    def forget(self, change: w.WorldChange) -> None:
        """Forget what was put off about the same thing, because this change comes later."""
        self._waiting.pop(w.subject(change), None)


def outline_of(change: w.WorldChange, base: Scene) -> w.Outline | None:
    """Return where a door, thing or person stands after a change in a scene; None where nothing does."""
    match change:
        case w.DoorMoved(door, is_open):
            return None if is_open else leaf_outline(base.parts.doors[door])
        case w.ThingPlaced(thing, kind, (x, y, yaw), (width, depth, height)):
            if kind is w.ThingKind.FURNITURE:
                piece = own_piece(base, thing)
                width = piece.width
                depth = piece.depth
            return w.Outline(x=x, y=y, yaw=yaw, width=width, depth=depth, height=height)
        case w.ThingReturned(thing):
            piece = own_piece(base, thing)
            return w.Outline(
                x=piece.x,
                y=piece.y,
                yaw=piece.yaw_rad,
                width=piece.width,
                depth=piece.depth,
                height=_FURNITURE_HEIGHT_M,
            )
        case w.PersonMoved():
            return person_outline(change)
        case w.ThingRemoved() | w.PersonLeft() | w.LightChanged() | w.PicturesExchanged() | w.TimePassed():
            return None
        case _:
            assert_never(change)


def own_piece(base: Scene, thing: str) -> FurniturePiece:
    """Return the piece of a scene's own furniture that `thing` names."""
    return next(piece for piece in base.parts.furniture if w.OWN_PREFIX + piece.name == thing)


def distance_m(outline: w.Outline, x: float, y: float) -> float:
    """Return how far a place is from an outline in metres; 0 within it."""
    cos = math.cos(outline.yaw)
    sin = math.sin(outline.yaw)
    ahead = x - outline.x
    aside = y - outline.y
    across = max(abs(cos * ahead + sin * aside) - outline.width / 2, 0.0)
    along = max(abs(cos * aside - sin * ahead) - outline.depth / 2, 0.0)
    return math.hypot(across, along)


_ADDED_OBSTACLES = "added"


@runtime_checkable
class ChangingRenderer(Protocol):
    """A renderer that can show another state of its scene."""

    def show(self, scene: "Scene") -> None:
        """Render this state from now on."""
        ...


class WorldFollower:
    """Keeps the body and the renderer of one robot up to date."""

    def __init__(self, world: World, body: Body, renderer: Renderer) -> None:
        """Begin with a world whose present scene the body knows already.

        Raises SceneError for a renderer that cannot show changes.
        """
        if not isinstance(renderer, ChangingRenderer):
            raise SceneError(
                f"{type(renderer).__name__} cannot show a world that changes: it has no method `show(scene)`. Use "
                "`open_renderer`, or leave the robot without a world."
            )
        self._world = world
        self._body = body
        self._renderer = renderer
        # What belongs to the scene itself is seldom moved and large; the rest is small, and a group of its own.
        self._own = world.scene.clearance.blocked
        self._blocked = self._own
        self._shown: object = None
        self._people: tuple[PersonMoved, ...] = ()
        self.show()
        self.follow_people()

    def show(self) -> None:
        """Show the camera the world as it is now."""
        if self._world.state is not self._shown:
            self._shown = self._world.state
            self._renderer.show(self._world.scene)

    def follow(self) -> ClearanceMap:
        """Let the body meet what blocks the floor now, and return the clearance map of it."""
        clearance = self._world.scene.clearance
        if clearance.blocked is not self._blocked:
            self._blocked = clearance.blocked
            if (self._own & ~self._blocked).any():
                self._own = self._own & self._blocked
                self._set(SCENE_OBSTACLES, clearance, self._own)
            self._set(_ADDED_OBSTACLES, clearance, self._blocked & ~self._own)
        self.follow_people()
        return clearance

    def follow_people(self) -> None:
        """Let the body meet people where they are now."""
        people = self._world.state.people
        if people is not self._people:
            self._people = people
            self._body.set_people({each.person: each.pose[:2] for each in people})

    def _set(self, group: str, clearance: ClearanceMap, blocked: np.ndarray) -> None:
        part = ClearanceMap(blocked, clearance.origin, clearance.resolution_m)
        self._body.set_obstacles(group, *extrude_blocked_cells(part, OBSTACLE_HEIGHT_M))
