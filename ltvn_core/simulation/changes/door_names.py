"""What a person calls the doors of a scene: by the rooms that they join."""

from collections import Counter

from ltvn_core.simulation.rooms import Room
from ltvn_core.simulation.scene import Scene


def door_names(scene: Scene) -> tuple[str, ...]:
    """Return a name for each door of a scene, such as `hall – kitchen`."""
    names = _room_names(scene.rooms)
    return tuple(" – ".join(names[room] for room in doorway.rooms) for doorway in scene.parts.doors)


def _room_names(rooms: tuple[Room, ...]) -> tuple[str, ...]:
    """Return a name for each room; where several serve the same purpose they are numbered."""
    total, seen = Counter(room.kind for room in rooms), Counter[object]()
    names: list[str] = []
    for room in rooms:
        seen[room.kind] += 1
        names.append(room.kind.value + (f" {seen[room.kind]}" if total[room.kind] > 1 else ""))
    return tuple(names)
