"""The type of a scene, generated or read from a mesh, with its export and display names for its doors.

`scene_registry` finds scenes by name or by path. Viewers such as the page and Rerun take the surfaces of a scene as
binary glTF.
"""

import io
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap, extrude_blocked_cells
from ltvn_core.simulation.rooms import Room, SceneParts
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces, joined, shrink_to_budget
from ltvn_core.types import Rgb

MAX_EXPORTED_TEXELS = 8_000_000
"""Maximum number of texels of an exported file. A mesh scene with more texels is shown more coarsely than it is
rendered."""


CORNER_LIGHT = "_LIGHT"
"""Name of the attribute of corners (3,) with the share of light of each colour that they reflect."""


def to_glb(
    surfaces: Surfaces, face_light: NDArray[np.floating] | None = None, *, most_texels: int = MAX_EXPORTED_TEXELS
) -> bytes:
    """Return a GLB file with one mesh per texture, in metres, z up, textures as JPEG.

    Textures are shrunk until all together have at most `most_texels`. If the light of faces is given, (F,) in [0, 1],
    corners have the attribute `CORNER_LIGHT`.
    """
    scene = trimesh.Scene()
    used = np.unique(surfaces.face_texture)
    for texture, image in zip(used, shrink_to_budget([surfaces.textures[k] for k in used], most_texels), strict=True):
        chosen = surfaces.face_texture == texture
        part = _part(surfaces.only(chosen), image)
        if face_light is not None:
            light = np.repeat(face_light[chosen], 3)[:, None]
            part.vertex_attributes[CORNER_LIGHT] = np.repeat(light, 3, axis=1).astype(np.float32)
        scene.add_geometry(part, geom_name=f"part{texture}")
    return cast(bytes, scene.export(file_type="glb"))


def _part(surfaces: Surfaces, image: Rgb) -> trimesh.Trimesh:
    corners = surfaces.vertices[surfaces.faces].reshape(-1, 3)
    material = PBRMaterial(
        baseColorTexture=_compressed(image),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    visual = TextureVisuals(uv=surfaces.corner_uv.reshape(-1, 2), material=material)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)


def _compressed(texture: Rgb) -> Image.Image:
    """Encode the texture as JPEG, because trimesh embeds an image in its own format and PNG is several times larger."""
    buffer = io.BytesIO()
    Image.fromarray(texture).save(buffer, "JPEG", quality=85)
    return Image.open(buffer)


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
