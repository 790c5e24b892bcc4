"""The scene without its ceiling, and the objects that were added to it; a plain floor if the scene is unknown."""

import time
from collections.abc import Callable
from dataclasses import replace

import viser

from ltvn_core.errors import LtvnError
from ltvn_core.worlds import AS_MADE, WorldState
from ltvn_viz.layers.scene_assets import without_guests
from ltvn_viz.session.snapshot import Snapshot

LINGER_S = 1.5
"""Time for which the old scene stays under the new one, in seconds, because a page takes a while to unpack it."""
NAMES = ("/apartment", "/apartment-again")


class SceneLayer:
    """The scene around the map; replaced if a recording was made in another scene."""

    def __init__(
        self,
        scene: viser.SceneApi,
        load: Callable[[str, WorldState], bytes],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Load the GLB of a scene by `load`, from the scene's name and state; at first there is only the floor, which
        is hidden."""
        self._scene = scene
        self._load = load
        self._clock = clock
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
        self._before: viser.GlbHandle | None = None
        self._before_until = 0.0

    def show(self, snapshot: Snapshot) -> None:
        """Draw the scene that the snapshot names; a floor with a grid in metres if that scene is not installed."""
        shown = snapshot.scene, without_guests(snapshot.moment.progress.world)  # `AddedLayer` draws added objects.
        if self._before is not None and self._clock() >= self._before_until:
            self._take_before_away()
        if shown == self._shown:
            return
        is_elsewhere = shown[0] != self._shown[0]
        self._shown = shown
        try:
            glb = self._load(*shown)
        except LtvnError:
            glb = None  # The user's own robot and recordings of unknown scenes are shown without walls.
        self.floor.visible = glb is None
        if self.handle is not None:
            self.handle.visible = glb is not None
        if glb is not None:
            self._exchange(glb)
        if is_elsewhere:
            self._take_before_away()

    def _exchange(self, glb: bytes) -> None:
        """Draw another scene; the old one stays below it for a while."""
        self._take_before_away()
        free = next(name for name in NAMES if self.handle is None or name != self.handle.name)
        self._before = self.handle
        self._before_until = self._clock() + LINGER_S
        self.handle = self._scene.add_glb(free, glb, cast_shadow=False, receive_shadow=False)

    def _take_before_away(self) -> None:
        if self._before is not None:
            self._before.remove()
        self._before = None


class AddedLayer:
    """Closed doors, added objects and people at the moment on show."""

    def __init__(self, scene: viser.SceneApi, load: Callable[[str, WorldState], bytes | None]) -> None:
        """Load their GLB by `load`, from the scene's name and state; nothing is drawn yet."""
        self._scene = scene
        self._load = load
        self._shown: tuple[str, WorldState] = ("", AS_MADE)
        self.handle: viser.GlbHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw the added parts; nothing in a scene that is not installed."""
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
