"""What the page offers to change in a simulated world, as a value: its doors, boxes and light."""

from collections import Counter
from dataclasses import dataclass

from ltvn_core.simulation.rooms import Doorway, Room
from ltvn_core.simulation.scene import Scene


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
class WorldView:
    """What of a world can be changed now."""

    doors: tuple[DoorView, ...]
    boxes: tuple[int, ...]
    """Numbers of the boxes that were put down."""
    light: float
    """Brightness; 1 is the scene as it was made."""
    undo: str
    """What would be undone, in words; empty where nothing would."""


def doors_of(scene: Scene) -> tuple[DoorView, ...]:
    """Return the doors of a scene, all open."""
    names = room_names(scene.rooms)
    return tuple(_door(number, doorway, names) for number, doorway in enumerate(scene.parts.doors))


def room_names(rooms: tuple[Room, ...]) -> tuple[str, ...]:
    """Return a name for each room; where several serve the same purpose they are numbered."""
    total, seen = Counter(room.kind for room in rooms), Counter[object]()
    names: list[str] = []
    for room in rooms:
        seen[room.kind] += 1
        names.append(room.kind.value + (f" {seen[room.kind]}" if total[room.kind] > 1 else ""))
    return tuple(names)


def _door(number: int, doorway: Doorway, names: tuple[str, ...]) -> DoorView:
    first, second = (names[room] for room in doorway.rooms)
    x, y = doorway.middle
    return DoorView(
        door=number,
        label=f"{first} – {second}",
        x=x,
        y=y,
        along_x=doorway.axis == 1,
        width_m=doorway.width_m,
    )
