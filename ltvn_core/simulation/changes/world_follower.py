"""Lets a robot's body and camera meet a world as it is now, at the cost of what is different alone."""

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from ltvn_core.errors import SceneError
from ltvn_core.simulation.body import SCENE_OBSTACLES, Body
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap, extrude_blocked_cells
from ltvn_core.types import Renderer
from ltvn_core.worlds.world_change import PersonMoved

if TYPE_CHECKING:
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.scene import Scene

_ADDED_OBSTACLES = "added"


@runtime_checkable
class ChangingRenderer(Protocol):
    """A renderer that can show another state of its scene."""

    def show(self, scene: "Scene") -> None:
        """Render this state from now on."""
        ...


class WorldFollower:
    """Keeps the body and the renderer of one robot up to date."""

    def __init__(self, world: "World", body: Body, renderer: Renderer) -> None:
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
