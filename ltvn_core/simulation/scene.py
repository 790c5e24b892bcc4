"""The type of a scene, generated or read from a mesh, with its export and display names for its doors.

`scene_registry` finds scenes by name or by path. Viewers such as the page and Rerun take the surfaces of a scene as
binary glTF.
"""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap, extrude_blocked_cells
from ltvn_core.simulation.rooms import Room, SceneParts
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces, joined

RECORDED_TEXELS = 300_000
"""Maximum number of texels of a scene in a recording; each recording contains its scene as background of the map."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An environment in which a simulated robot can drive."""

    name: str
    area_m2: float
    """Area of the floor between the outer walls, in square metres."""
    rooms: tuple[Room, ...]
    clearance: ClearanceMap
    surfaces: Surfaces
    source: Path | None = None
    """Absolute path of the mesh file or folder; None for a generated scene."""
    parts: SceneParts = field(default_factory=SceneParts)
    """Parts that can be moved or exchanged."""
    added: tuple[Surfaces, ...] = ()
    """Surfaces currently added to its own: leaves of closed doors, things, people."""
    light: Light = PLAIN_LIGHT
    doubts: tuple[str, ...] = ()
    """Missing parts of the mesh file, in whole sentences with what to do."""

    @property
    def address(self) -> str:
        """The argument with which `load_scene` finds this scene again from any folder; recordings store it."""
        return self.name if self.source is None else str(self.source)

    def collision_triangles(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return vertices (V, 3) in metres and faces (F, 3) of all obstacles."""
        return extrude_blocked_cells(self.clearance, OBSTACLE_HEIGHT_M)

    def glb(self) -> bytes:
        """Return the scene for recordings: binary glTF, z up, without ceilings, with small textures."""
        from ltvn_core.simulation.scene_glb import to_glb

        whole = joined([self.surfaces, *self.added]) if self.added else self.surfaces
        return to_glb(whole.without_overhead(), most_texels=RECORDED_TEXELS)


def door_names(scene: Scene) -> tuple[str, ...]:
    """Return a name for each door of a scene, such as `hall – kitchen`."""
    names = room_names(scene.rooms)
    return tuple(" – ".join(names[room] for room in doorway.rooms) for doorway in scene.parts.doors)


def room_names(rooms: tuple[Room, ...]) -> tuple[str, ...]:
    """Return a name for each room; rooms of the same kind are numbered."""
    total = Counter(room.kind for room in rooms)
    seen = Counter[object]()
    names: list[str] = []
    for room in rooms:
        seen[room.kind] += 1
        names.append(room.kind.value + (f" {seen[room.kind]}" if total[room.kind] > 1 else ""))
    return tuple(names)
