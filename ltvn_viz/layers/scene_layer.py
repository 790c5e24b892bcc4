"""The apartment, with its ceiling cut away."""

from collections.abc import Callable

import viser

from ltvn_core.errors import LtvnError
from ltvn_viz.session.snapshot import Snapshot


class SceneLayer:
    """The place in which all of it happens; exchanged when a replay was made elsewhere."""

    def __init__(self, scene: viser.SceneApi, load: Callable[[str], bytes]) -> None:
        """Remember how to `load` the GLB of a scene by its name; nothing is drawn yet."""
        self._scene, self._load = scene, load
        self._shown = ""
        self.handle: viser.GlbHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw the scene that the snapshot names; one that this machine does not have is left out."""
        if snapshot.scene == self._shown:
            return
        self._shown = snapshot.scene
        try:
            glb = self._load(snapshot.scene)
        except LtvnError:
            glb = None  # The replay of a foreign recording is worth seeing without its walls.
        if self.handle is not None:
            self.handle.visible = glb is not None
        if glb is not None:
            self.handle = self._scene.add_glb("/apartment", glb, cast_shadow=False, receive_shadow=False)
