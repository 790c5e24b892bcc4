"""Handles for changes of a simulated world: one on each doorway, and one on each box that a person put down.

The page's script takes the clicks on them (`static/plan_view.js`).
"""

import viser

from ltvn_core import palette
from ltvn_viz.session.snapshot import BoxView, DoorView, Snapshot

DOOR_HANDLE_Z = 1.45
"""Height of the door handles in metres, just above the cut walls."""
_DOOR_HANDLE_M = (0.12, 0.12)
"""Depth and height of a door handle in metres; its length is the width of the doorway."""


class DoorsLayer:
    """Bars above doorways: green for open doors, magenta for closed ones."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Start without handles."""
        self._scene = scene
        self._shown: tuple[DoorView, ...] = ()
        self.handles: dict[int, viser.BoxHandle] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Draw the doors that can be changed now; none in a replay."""
        doors = () if snapshot.world is None else snapshot.world.doors
        if doors == self._shown:
            return
        if {each.door for each in doors} != self.handles.keys():
            self._add(doors)
        for each in doors:
            self.handles[each.door].color = palette.EDGE_ADDED if each.is_open else palette.EDGE_REMOVED
        self._shown = doors

    def _add(self, doors: tuple[DoorView, ...]) -> None:
        for handle in self.handles.values():
            handle.remove()
        depth, height = _DOOR_HANDLE_M
        self.handles = {
            each.door: self._scene.add_box(
                f"/doors/{each.door}",
                dimensions=(each.width_m, depth, height) if each.along_x else (depth, each.width_m, height),
                position=(each.x, each.y, DOOR_HANDLE_Z),
                opacity=0.75,
            )
            for each in doors
        }


BOX_HANDLE_Z = 0.62
"""Height of a box handle in metres, just above the box."""
_BOX_HANDLE_M = 0.16


class BoxesLayer:
    """Small cubes above boxes."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Start without handles."""
        self._scene = scene
        self._shown: tuple[BoxView, ...] = ()
        self.handles: dict[int, viser.BoxHandle] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Draw the boxes that can be moved now; none in a replay."""
        boxes = () if snapshot.world is None else snapshot.world.boxes
        if boxes == self._shown:
            return
        self._shown = boxes
        for handle in self.handles.values():
            handle.remove()
        self.handles = {
            each.number: self._scene.add_box(
                f"/boxes/{each.number}",
                color=palette.ACCENT,
                dimensions=(_BOX_HANDLE_M, _BOX_HANDLE_M, _BOX_HANDLE_M),
                position=(each.x, each.y, BOX_HANDLE_Z),
                opacity=0.75,
            )
            for each in boxes
        }
