"""The scene with its ceiling cut away, or a plain floor where nobody has a model of the place."""

from collections.abc import Callable

import viser

from ltvn_core.errors import LtvnError
from ltvn_viz.session.snapshot import Snapshot


class SceneLayer:
    """The place in which all of it happens; exchanged when a replay was made elsewhere."""

    def __init__(self, scene: viser.SceneApi, load: Callable[[str], bytes]) -> None:
        """Remember how to `load` the GLB of a scene by its name; only the hidden floor is drawn yet."""
        self._scene, self._load = scene, load
        self._shown = ""
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
        if snapshot.scene == self._shown:
            return
        self._shown = snapshot.scene
        try:
            glb = self._load(snapshot.scene)
        except LtvnError:
            glb = None  # A robot of one's own and a foreign recording are worth seeing without walls.
        self.floor.visible = glb is None
        if self.handle is not None:
            self.handle.visible = glb is not None
        if glb is not None:
            self.handle = self._scene.add_glb("/apartment", glb, cast_shadow=False, receive_shadow=False)
