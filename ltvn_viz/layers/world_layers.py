"""Handles for changes of a simulated world: one on each doorway, and one on each box that a person put down.

A click on a door's handle closes or opens the door; a click on a box's handle selects the box, and the next click on
the floor moves it there.
"""

from collections.abc import Callable
from functools import partial

import viser

from ltvn_core import palette
from ltvn_viz.session.snapshot import BOX_SIZE_M, BoxView, DoorView, FloorView, Snapshot

DOOR_HANDLE_Z = 1.45
"""Height of the door handles in metres, just above the cut walls."""
_DOOR_HANDLE_M = (0.12, 0.12)
"""Depth and height of a door handle in metres; its length is the width of the doorway."""


class DoorsLayer:
    """Bars above doorways: green for open doors, magenta for closed ones."""

    def __init__(self, scene: viser.SceneApi, on_pick: Callable[[int], None]) -> None:
        """Start without handles; `on_pick` gets the number of a door, and must return at once."""
        self._scene = scene
        self._on_pick = on_pick
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
            depth, height = _DOOR_HANDLE_M
            size = (each.width_m, depth, height) if each.along_x else (depth, each.width_m, height)
            handle = self._scene.add_box(
                f"/doors/{each.door}", dimensions=size, position=(each.x, each.y, DOOR_HANDLE_Z), opacity=0.75
            )
            handle.on_click(partial(self._clicked, each.door))
            self.handles[each.door] = handle

    async def _clicked(self, door: int, _: viser.SceneNodePointerEvent) -> None:
        self._on_pick(door)


BOX_HANDLE_Z = BOX_SIZE_M[2] + 0.12
"""Height of a box handle in metres, just above the box."""
_BOX_HANDLE_M = 0.16
_FLOOR_M = 0.04
"""Thickness in metres of the coloured sheet that receives the click on the floor."""


class BoxesLayer:
    """Small cubes above boxes; a click on a cube selects the box, which moves to the next click on the floor."""

    def __init__(
        self,
        scene: viser.SceneApi,
        on_pick: Callable[[int], None],
        on_floor: Callable[[tuple[float, float]], None],
    ) -> None:
        """Start without handles. `on_pick` gets the number of a box, `on_floor` a place (x, y) in metres; both must
        return at once."""
        self._scene = scene
        self._on_pick = on_pick
        self._on_floor = on_floor
        self._shown: tuple[BoxView, ...] = ()
        self.handles: dict[int, viser.BoxHandle] = {}
        self.floor: viser.BoxHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw the boxes that can be moved now; none in a replay."""
        world = snapshot.world
        boxes = () if world is None else world.boxes
        if boxes != self._shown:
            self._shown = boxes
            self._show_handles(boxes)
        self._show_floor(None if world is None or world.aimed is None else world.floor)

    def _show_handles(self, boxes: tuple[BoxView, ...]) -> None:
        for handle in self.handles.values():
            handle.remove()
        self.handles = {}
        for each in boxes:
            handle = self._scene.add_box(
                f"/boxes/{each.number}",
                color=palette.ACCENT,
                dimensions=(_BOX_HANDLE_M, _BOX_HANDLE_M, _BOX_HANDLE_M),
                position=(each.x, each.y, BOX_HANDLE_Z),
                opacity=0.75,
            )
            handle.on_click(partial(self._clicked, each.number))
            self.handles[each.number] = handle

    def _show_floor(self, floor: FloorView | None) -> None:
        if floor is None:
            if self.floor is not None:
                self.floor.remove()
                self.floor = None
            return
        if self.floor is None:
            self.floor = self._scene.add_box(
                "/floor_to_click",
                color=palette.ACCENT,
                dimensions=(floor.x1 - floor.x0, floor.y1 - floor.y0, _FLOOR_M),
                position=((floor.x0 + floor.x1) / 2, (floor.y0 + floor.y1) / 2, _FLOOR_M / 2),
                opacity=0.4,
            )
            self.floor.on_click(self._clicked_floor)

    async def _clicked(self, box: int, _: viser.SceneNodePointerEvent) -> None:
        self._on_pick(box)

    async def _clicked_floor(self, event: viser.SceneNodePointerEvent) -> None:
        (x, y, z), (along_x, along_y, along_z) = event.ray_origin, event.ray_direction
        if along_z < 0:
            self._on_floor((x - z / along_z * along_x, y - z / along_z * along_y))
