"""A scene that changes over time: applies the changes of a script and of a person, and notifies its followers.

Holds the time of the world, its state, the progress of its script, and the robot that changes must not hit. Owns the
outlines of changed objects. Physics and camera belong to the robot; `WorldFollower` updates them. Recordings and views
are followers, too.
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
"""Called with the changes, in the thread that made them; `World.scene` is then the changed scene."""
_ROOM_M = 0.05
"""Least distance of a placed object from a robot or a person, in metres."""
_TELL_PEOPLE_S = 0.5
"""Time between two notifications about walking people, in seconds."""
_FURNITURE_HEIGHT_M = 1.0


class RobotInside(Protocol):
    """The interface of a robot that a world needs."""

    @property
    def exact_pose(self) -> Pose:
        """Exact pose (3,) of the robot."""
        ...

    @property
    def stamp(self) -> float:
        """Time in seconds on the robot's clock."""
        ...


class World:
    """One scene over time. All methods are for the thread that moves the robot."""

    def __init__(self, scene: Scene, script: WorldScript = STATIC, *, start_s: float = MORNING_S) -> None:
        """Start at `start_s` seconds after midnight of the first day, with all earlier changes of the script applied.

        Raises WorldError if the script has a change that is impossible in the scene.
        """
        self.base = scene
        """The unchanged scene."""
        self.script = script
        self.state: WorldState = AS_MADE
        """Current changes."""
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
        """State at the last notification about people."""
        for timed in self._script.due(start_s):
            check_change(timed.change, scene, self.state)
            self.state = self.state.after(timed.change)

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self._scenes.at(self.state)

    @property
    def stepping_aside(self) -> tuple[str, ...]:
        """Names of the people who make room for the robot now."""
        return self._people.stepping_aside

    @property
    def time_s(self) -> float:
        """Seconds from midnight of the world's first day."""
        return self._epoch_s + self._stamp

    def follow(self, follower: Follower) -> None:
        """Notify a follower of every change from now on."""
        self._followers.append(follower)

    def unfollow(self, follower: Follower) -> None:
        """Stop notifying a follower."""
        self._followers = [each for each in self._followers if each != follower]

    def enter(self, body: RobotInside, radius_m: float) -> None:
        """Add a robot in place of any earlier one.

        Nothing is placed on the robot, and its clock drives the time of the world.
        """
        self._epoch_s = self.time_s - body.stamp
        self._stamp = body.stamp
        self._body = body
        self._radius_m = radius_m
        self.make_room(body.exact_pose)

    def make_room(self, pose: Pose) -> None:
        """Move people away from a pose (3,) at which the robot is placed."""
        self._people.send_away_from(pose)
        self._move_people()

    def leave(self, body: RobotInside) -> None:
        """Remove a robot; time stands still until another one is added."""
        if self._body is body:
            self._body = None

    def apply(self, change: w.WorldChange, by: ChangedBy = ChangedBy.HAND) -> None:
        """Change the world now, or let time pass.

        Raises WorldError for an impossible change: an unknown door, nothing to remove, an object on the robot.
        """
        check_change(change, self.base, self.state)
        if isinstance(change, w.TimePassed):
            self.skip(change.duration_s)
            return
        if isinstance(change, w.ThingPlaced):
            check_floor(change, self._scenes.at(self.state.after(w.ThingRemoved(change.thing))))
        self._change([change], by)

    def undo_to(self, before: WorldState) -> None:
        """Restore an earlier state by hand, except for people.

        Raises WorldError if the robot or a person is in the way.
        """
        self._change(self.state.changes_to(replace(before, people=self.state.people)), ChangedBy.HAND)

    def advance_to(self, stamp: float) -> None:
        """Let time pass until `stamp` on the robot's clock, and apply the changes of the script."""
        duration_s, self._stamp = stamp - self._stamp, stamp
        self._tell([*self._scripted(), *self._walked(duration_s)])

    def skip(self, duration_s: float) -> None:
        """Let time pass while the robot's clock stands still; takes only the computing time of the changes."""
        passed = w.TimePassed(duration_s)
        check_change(passed, self.base, self.state)
        self._epoch_s += duration_s
        self._people.scatter()
        self._move_people()
        events = [self._carry_out(passed, ChangedBy.HAND, self.time_s), *self._scripted()]
        self._tell([*events, *self._walked(0.0)])

    def reachable(self, start: Pose, goals: Pose) -> NDArray[np.bool_]:
        """Return which goals (N, 3) a robot at a pose (3,) can reach in the current world, (N,)."""
        return np.isfinite(self.scene.clearance.path_lengths(start, np.asarray(goals)[:, :2]))

    def events(self) -> list[WorldChanged]:
        """Return the first events of a recording: the time and the state of the world.

        Empty for an unchanged scene without a script.
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
        """Apply the changes of the script that are due; a change waits while the robot or a person blocks it."""
        for timed in self._script.due(self.time_s):
            try:
                check_change(timed.change, self.base, self.state)
            except WorldError as no_more:  # A person may have made the change impossible.
                log.debug("A change of the script is not possible any more: %s", no_more)
                continue
            if self._in_the_way(timed.change) is None:
                yield self._carry_out(timed.change, ChangedBy.SCRIPT, timed.at_s)
            else:
                self._script.put_off(timed.change)

    def _walked(self, duration_s: float) -> list[WorldChanged]:
        """Let people walk. Their state changes at each step, but followers are notified only a few times a second."""
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
        """Return the reason why the robot or a person blocks a change; None if neither does."""
        outline = outline_of(change, self.base)
        if outline is None:
            return None
        if self._body is not None:
            x, y, _ = self._body.exact_pose
            if distance_m(outline, x, y) < self._radius_m + _ROOM_M:
                return f"This is impossible now ({w.change_text(change)}): the robot is there. Drive it away first."
        for person in self.state.people:
            x, y, _ = person.pose
            if not isinstance(change, w.PersonMoved) and distance_m(outline, x, y) < PERSON_RADIUS_M + _ROOM_M:
                return f"This is impossible now ({w.change_text(change)}): {person.person} is there. Wait a little."
        return None

    def _carry_out(self, change: w.WorldChange, by: ChangedBy, at_s: float) -> WorldChanged:
        self.state = self.state.after(change)
        return WorldChanged(change, by, at_s, outline_of(change, self.base))

    def _tell(self, events: Sequence[WorldChanged]) -> None:
        if events:
            for follower in tuple(self._followers):
                follower(events)


class ScriptReader:
    """Reads one script in the order of time."""

    def __init__(self, script: WorldScript) -> None:
        """Start before the first change."""
        self._script = script
        self._next = 0
        self._waiting: dict[str, w.WorldChange] = {}
        """Postponed changes, by their subject."""

    def due(self, time_s: float) -> Iterator[TimedChange]:
        """Yield postponed changes, and then the changes of the script up to `time_s`; the caller may postpone each of
        them."""
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
        """Postpone a change, so that the next call of `due` yields it again."""
        self._waiting[w.subject(change)] = change

    def forget(self, change: w.WorldChange) -> None:
        """Drop a postponed change of the same subject, because the given change is later."""
        self._waiting.pop(w.subject(change), None)


def outline_of(change: w.WorldChange, base: Scene) -> w.Outline | None:
    """Return the outline of a door, thing or person after a change in a scene; None if the change has no outline."""
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
    """Return the distance of a place from an outline in metres; 0 within it."""
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
        """Start with a world whose current scene the body already has.

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
        # The scene itself is large and rarely changes; added objects are few, so they form a group of their own.
        self._own = world.scene.clearance.blocked
        self._blocked = self._own
        self._shown: object = None
        self._people: tuple[PersonMoved, ...] = ()
        self.show()
        self.follow_people()

    def show(self) -> None:
        """Update the camera to the current world."""
        if self._world.state is not self._shown:
            self._shown = self._world.state
            self._renderer.show(self._world.scene)

    def follow(self) -> ClearanceMap:
        """Update the body to the cells that are blocked now, and return their clearance map."""
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
        """Update the body to the current positions of people."""
        people = self._world.state.people
        if people is not self._people:
            self._people = people
            self._body.set_people({each.person: each.pose[:2] for each in people})

    def _set(self, group: str, clearance: ClearanceMap, blocked: np.ndarray) -> None:
        part = ClearanceMap(blocked, clearance.origin, clearance.resolution_m)
        self._body.set_obstacles(group, *extrude_blocked_cells(part, OBSTACLE_HEIGHT_M))
