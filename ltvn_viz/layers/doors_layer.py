"""A handle on each doorway of a simulated world: a click closes or opens the door."""

from collections.abc import Callable
from functools import partial

import viser

from ltvn_core import palette
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.world_view import DoorView

HANDLE_Z = 1.45
"""Just above the walls as they are cut."""
HANDLE_M = (0.12, 0.12)
"""Depth and height; it is as long as the doorway is wide."""


class DoorsLayer:
    """Bars above doorways, green where one can go through and magenta where not."""

    def __init__(self, scene: viser.SceneApi, on_pick: Callable[[int, int], None]) -> None:
        """`on_pick` gets a door and viser's number of the page, and must return at once."""
        self._scene, self._on_pick = scene, on_pick
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
        self.handles = {}
        for each in doors:
            depth, height = HANDLE_M
            size = (each.width_m, depth, height) if each.along_x else (depth, each.width_m, height)
            handle = self._scene.add_box(
                f"/doors/{each.door}", dimensions=size, position=(each.x, each.y, HANDLE_Z), opacity=0.75
            )
            handle.on_click(partial(self._clicked, each.door))
            self.handles[each.door] = handle

    async def _clicked(self, door: int, event: viser.SceneNodePointerEvent) -> None:
        self._on_pick(door, event.client_id)
