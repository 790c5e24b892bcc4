"""What the page offers to change in a simulated world, as a value: its doors, boxes and light."""

from dataclasses import dataclass
from typing import NamedTuple

from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.scene import Scene, door_names

BOX_SIZE_M = (0.4, 0.4, 0.5)
"""Width, depth and height of a box that is put down."""


@dataclass(frozen=True, slots=True)
class DoorView:
    """A door that a person may close or open."""

    door: int
    """Its number among the scene's doors."""
    label: str
    """Which rooms it joins."""
    x: float
    y: float
    """Its middle in metres."""
    along_x: bool
    """Whether its wall runs along x."""
    width_m: float
    is_open: bool = True


@dataclass(frozen=True, slots=True)
class BoxView:
    """A box that was put down."""

    number: int
    x: float
    y: float
    """Its middle in metres."""


class FloorView(NamedTuple):
    """The rectangle around all of a scene's floor, in metres."""

    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True, slots=True)
class WorldView:
    """What of a world can be changed now."""

    floor: FloorView
    doors: tuple[DoorView, ...]
    boxes: tuple[BoxView, ...]
    aimed: int | None
    """Number of the box that waits for a click on the floor, 0 for a new one; None where none does."""
    light: float
    """Brightness; 1 is the scene as it was made."""
    undo: str
    """What would be undone, in words; empty where nothing would."""


def doors_of(scene: Scene) -> tuple[DoorView, ...]:
    """Return the doors of a scene, all open."""
    named = zip(door_names(scene), scene.parts.doors, strict=True)
    return tuple(_door(number, name, doorway) for number, (name, doorway) in enumerate(named))


def floor_of(scene: Scene) -> FloorView:
    """Return where the floor of a scene is."""
    clearance = scene.clearance
    rows, columns = clearance.blocked.shape
    x, y = clearance.origin.tolist()
    return FloorView(x, y, x + columns * clearance.resolution_m, y + rows * clearance.resolution_m)


def _door(number: int, name: str, doorway: Doorway) -> DoorView:
    x, y = doorway.middle
    return DoorView(
        door=number,
        label=name,
        x=x,
        y=y,
        along_x=doorway.axis == 1,
        width_m=doorway.width_m,
    )
