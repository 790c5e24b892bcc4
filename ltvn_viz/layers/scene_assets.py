"""Scenes as the page draws them, with their light painted in, so that the page need not compute any.

A browser without a GPU draws a lit scene many times slower than a painted one; and painted, it looks like what the
robot's camera sees. The shades are in the corners and not in the textures: of each texture there would be three, and
the page would draw three times as many parts.
"""

import json
import struct
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.gltf_export import CORNER_LIGHT, to_glb
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces, joined
from ltvn_core.structured_text import parse_json
from ltvn_core.worlds.world_change import OWN_PREFIX
from ltvn_core.worlds.world_state import AS_MADE, WorldState
from ltvn_viz.layers.cutaway import cut_away

FACE_BRIGHTNESS = (0.95, 0.8, 0.68)
"""How bright faces are: level ones, those that look along x, and those that look along y."""
UNLIT_EXTENSION = "KHR_materials_unlit"
_GAMMA = 2.2
_JSON_CHUNK = 0x4E4F534A


def scene_glb(name: str, state: WorldState = AS_MADE) -> bytes:
    """Return a scene as binary glTF, cut open and with its light painted in; raises SceneError for an unknown one.

    Leaves of closed doors, things and people of that state are not in it.
    """
    own = tuple(each for each in state.things if each.thing.startswith(OWN_PREFIX))
    bare = replace(AS_MADE, things=own, missing=state.missing, pictures=state.pictures)
    return marked_unlit(_own_glb(name, bare), Light.of(state.light.level, state.light.warmth))


def added_glb(name: str, state: WorldState) -> bytes | None:
    """Return what stands in a scene for now as binary glTF: leaves, things and people; None where nothing does.

    Raises SceneError for an unknown scene.
    """
    scenes = _scenes(name)
    standing = scenes.at(replace(AS_MADE, closed_doors=state.closed_doors, things=state.things)).added
    people = scenes.at(replace(AS_MADE, people=state.people)).added
    parts = [*map(cut_away, standing), *people]
    if not parts:
        return None
    return marked_unlit(_glb(joined(parts)), Light.of(state.light.level, state.light.warmth))


@lru_cache(maxsize=4)
def _own_glb(name: str, state: WorldState) -> bytes:
    scene = load_scene(name) if state == AS_MADE else _scenes(name).at(state)
    return _glb(cut_away(scene.surfaces))


@lru_cache(maxsize=2)
def _scenes(name: str) -> ChangedScenes:
    return ChangedScenes(load_scene(name))


def _glb(surfaces: Surfaces) -> bytes:
    return to_glb(surfaces, face_light(surfaces))


def floor_bounds(name: str) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return the low and the high corner (x_m, y_m) of a scene, None for an unknown one."""
    try:
        vertices, _ = load_scene(name).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)


def face_light(surfaces: Surfaces) -> NDArray[np.floating]:
    """Return how much light faces send back (F,), in [0, 1], by where they look."""
    a, b, c = np.moveaxis(surfaces.vertices[surfaces.faces], 1, 0)
    normal = np.abs(np.cross(b - a, c - a))
    shade = np.select([normal[:, 2] >= normal[:, :2].max(axis=1), normal[:, 0] >= normal[:, 1]], [0, 1], 2)
    # Brightness is what the eye sees; glTF counts light itself.
    return np.asarray(FACE_BRIGHTNESS)[shade] ** _GAMMA


def marked_unlit(glb: bytes, light: Light = PLAIN_LIGHT) -> bytes:
    """Mark all materials of a binary glTF as showing their textures as they are, in some light.

    What `to_glb` wrote of the light of faces becomes their colour.
    """
    (length,) = struct.unpack_from("<I", glb, 12)
    described = parse_json(glb[20 : 20 + length])
    for part in (part for mesh in described["meshes"] for part in mesh["primitives"]):
        if CORNER_LIGHT in part["attributes"]:
            part["attributes"]["COLOR_0"] = part["attributes"].pop(CORNER_LIGHT)
    for material in described["materials"]:
        material.setdefault("extensions", {})[UNLIT_EXTENSION] = {}
        if light != PLAIN_LIGHT:
            # glTF counts light itself, textures count what the eye sees of it. Here only half of the light is missing
            # that the camera lacks, so that a person still finds the way. More than all light is not allowed.
            factors = [min(share, 1.0) ** (_GAMMA / 2) for share in light]
            material.setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = [*factors, 1.0]
    described["extensionsUsed"] = sorted({*described.get("extensionsUsed", ()), UNLIT_EXTENSION})
    text = json.dumps(described, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # glTF wants chunks in whole words.
    body = struct.pack("<II", len(text), _JSON_CHUNK) + text + glb[20 + length :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
