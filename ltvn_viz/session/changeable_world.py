"""Changes of the simulated world from the page: queued until the navigator is not computing.

Owns undo, and records every change of the world, by anyone, in timeline and recording. `ltvn_core.simulation.changes`
decides which changes are valid. For the session's thread only.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ltvn_core import worlds as w
from ltvn_core.errors import WorldError
from ltvn_core.geometry import compose
from ltvn_core.navigation.events import StampedEvent, WorldChanged
from ltvn_core.types import Pose
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.snapshot import BOX_SIZE_M, BoxView, WorldView, doors_of

if TYPE_CHECKING:
    from ltvn_core.simulation.changes.world import World

BOX_AHEAD_M = 0.75
"""Distance between the centres of the robot and of a box put down in front of it, in metres."""
_BOX_NAME = "box "
_MOST_UNDONE = 100


class _Undo(NamedTuple):
    """The inverse of a change."""

    text: str
    changes: tuple[w.WorldChange, ...]


class ChangeableWorld:
    """The world of a simulated robot."""

    def __init__(self, world: "World", live: LiveRun, carry: Callable[[Pose], None]) -> None:
        """Write every change into the run from now on; `carry` puts the robot at a pose (3,)."""
        self.world = world
        self._live = live
        self.carry = carry
        """Moves the robot to a pose (3,); raises SceneError if it is occupied. Nothing else may drive the robot during
        the call."""
        self._doors = doors_of(world.base)
        self._aimed: int | None = None
        """Number of the box that waits for a click on its place, 0 for a new box; None without one."""
        self._asked: deque[Callable[[], str]] = deque()
        self._undo: deque[_Undo] = deque(maxlen=_MOST_UNDONE)
        self._view: WorldView | None = None
        world.follow(self._changed)
        self._changed(world.events())

    @property
    def view(self) -> WorldView:
        """Return the changes that are possible now; the same object until they differ."""
        state = self.world.state
        doors = tuple(replace(each, is_open=each.door not in state.closed_doors) for each in self._doors)
        undo = self._undo[-1].text if self._undo else ""
        boxes = tuple(BoxView(number, *self._boxes()[number]) for number in sorted(self._boxes()))
        aimed = self._aimed if not self._aimed or self._aimed in self._boxes() else None
        view = WorldView(doors, boxes, aimed, state.light.level, undo)
        self._view = view if self._view != view else self._view
        return self._view or view

    def toggle_door(self, door: int) -> None:
        """Close an open door, or open a closed one."""
        self._ask(lambda: w.DoorMoved(door, is_open=door in self.world.state.closed_doors))

    def aim_box(self, number: int) -> None:
        """Select a box, or a new one for 0, for the next click on the floor; deselect it if it is selected already."""
        if number and number not in self._boxes():
            raise WorldError(f"There is no box {number} to move; put one down first.")
        self._aimed = None if self._aimed == number else number

    def put_box(self, place: tuple[float, float] | None) -> None:
        """Place the selected box, or a new one, at x and y in metres; None places it in front of the robot."""
        aimed, self._aimed = self._aimed, None
        self._ask(lambda: self._box(place, (aimed or None) if place is not None else None))

    def take_box(self, number: int) -> None:
        """Remove a box."""
        self._ask(lambda: w.ThingRemoved(f"{_BOX_NAME}{number}"))

    def set_light(self, percent: int) -> None:
        """Set the brightness of the light, in percent of the scene's original brightness."""
        self._ask(lambda: w.LightChanged(percent / 100))

    def change(self, change: w.WorldChange) -> None:
        """Queue a change, as if a person made it."""
        self._ask(lambda: change)

    def undo(self) -> None:
        """Undo the last manual change."""
        self._asked.append(self._take_back)

    def carry_out(self) -> Sequence[str]:
        """Apply the queued changes; returns a description. Raises WorldError for an invalid change."""
        done: list[str] = []
        while self._asked:
            done.append(self._asked.popleft()())
        return done

    def record(self) -> None:
        """Write the state of the world into a new recording."""
        now = self._live.robot.state()
        for event in self.world.events():
            self._live.recorder.write_event(StampedEvent(now.step, now.stamp, event))

    def _ask(self, make: Callable[[], w.WorldChange]) -> None:
        self._asked.append(lambda: self._do(make()))

    def _do(self, change: w.WorldChange) -> str:
        before = self.world.state
        try:
            self.world.apply(change)
        except WorldError as error:
            raise WorldError(self._named(str(error))) from error
        text = self._named(w.change_text(change))
        if back := before.after(change).changes_to(before):
            self._undo.append(_Undo(text, back))
        return text

    def _take_back(self) -> str:
        if not self._undo:
            raise WorldError("There is nothing to undo; nothing was changed by hand yet.")
        last = self._undo[-1]
        for change in last.changes:
            self.world.apply(change)
        self._undo.pop()
        return f"undone: {last.text}"

    def _box(self, place: tuple[float, float] | None, number: int | None) -> w.ThingPlaced:
        boxes = self._boxes()
        number = number or next(number for number in range(1, len(boxes) + 2) if number not in boxes)
        x, y, yaw = (float(value) for value in compose(self._live.robot.drawn_pose, np.array([BOX_AHEAD_M, 0.0, 0.0])))
        pose = (x, y, yaw) if place is None else (*place, 0.0)
        return w.ThingPlaced(f"{_BOX_NAME}{number}", w.ThingKind.BOX, pose, BOX_SIZE_M)

    def _boxes(self) -> dict[int, tuple[float, float]]:
        """Return the positions (x, y) in metres of the boxes that a person put down, by number."""
        named = ((each.thing.removeprefix(_BOX_NAME), each.pose) for each in self.world.state.things)
        return {int(name): pose[:2] for name, pose in named if name.isdecimal()}

    def _named(self, text: str) -> str:
        """Return a description in which doors have the names of their rooms, and boxes have their names."""
        for door in reversed(self._doors):
            text = text.replace(f"door {door.door} ", f"door {door.label} ")
        return text.replace(f"box {_BOX_NAME}", _BOX_NAME)

    def _changed(self, events: Sequence[WorldChanged]) -> None:
        for event in events:
            self._live.emit(event)
