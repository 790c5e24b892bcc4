"""The scene with its ceiling cut away and what stands in it for now, or a plain floor where nobody has a model."""

from collections.abc import Callable
from dataclasses import replace

import viser

from ltvn_core.errors import LtvnError
from ltvn_core.worlds.world_change import ThingKind
from ltvn_core.worlds.world_state import AS_MADE, WorldState
from ltvn_viz.session.snapshot import Snapshot


class SceneLayer:
    """The place in which all of it happens; exchanged when a replay was made elsewhere."""

    def __init__(self, scene: viser.SceneApi, load: Callable[[str, WorldState], bytes]) -> None:
        """Remember how to `load` the GLB of a scene by its name and state; only the hidden floor is drawn yet."""
        self._scene, self._load = scene, load
        self._shown: tuple[str, WorldState] = ("", AS_MADE)
        self.floor = scene.add_grid(
            "/floor",
            infinite_grid=True,
            fade_distance=30.0,
            cell_size=1.0,
            section_size=5.0,
            cell_color=(90, 96, 104),
            section_color=(130, 138, 148),
            shadow_opacity=0.0,
            visible=False,
        )
        self.handle: viser.GlbHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw the scene that the snapshot names; for one that this machine does not have, a floor in metres."""
        world = snapshot.moment.progress.world
        # What stands in it is `AddedLayer`'s.
        own = tuple(each for each in world.things if each.kind is ThingKind.FURNITURE)
        shown = snapshot.scene, replace(world, closed_doors=frozenset(), things=own, people=())
        if shown == self._shown:
            return
        self._shown = shown
        try:
            glb = self._load(*shown)
        except LtvnError:
            glb = None  # A robot of one's own and a foreign recording are worth seeing without walls.
        self.floor.visible = glb is None
        if self.handle is not None:
            self.handle.visible = glb is not None
        if glb is not None:
            self.handle = self._scene.add_glb("/apartment", glb, cast_shadow=False, receive_shadow=False)


class AddedLayer:
    """Leaves of closed doors, things and people, as they are at the moment on show."""

    def __init__(self, scene: viser.SceneApi, load: Callable[[str, WorldState], bytes | None]) -> None:
        """Remember how to `load` their GLB by the scene's name and state; nothing is drawn yet."""
        self._scene, self._load = scene, load
        self._shown: tuple[str, WorldState] = ("", AS_MADE)
        self.handle: viser.GlbHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw what stands there; nothing in a scene that this machine does not have."""
        shown = snapshot.scene, replace(snapshot.moment.progress.world, missing=frozenset(), pictures=None)
        if shown == self._shown:
            return
        self._shown = shown
        try:
            glb = self._load(*shown)
        except LtvnError:
            glb = None
        if self.handle is not None:
            self.handle.remove()
        self.handle = None
        if glb is not None:
            self.handle = self._scene.add_glb("/added", glb, cast_shadow=False, receive_shadow=False)
