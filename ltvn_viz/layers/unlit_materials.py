"""Light painted into the scene, so that the page need not compute any.

A browser without a GPU draws a lit scene many times slower than a painted one; and painted, it looks like what the
robot's camera sees. The shades are in the corners and not in the textures: of each texture there would be three, and
the page would draw three times as many parts. Owns the shades and the mark in the glTF.
"""

import json
import struct

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.gltf_export import CORNER_LIGHT
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces
from ltvn_core.structured_text import parse_json

FACE_BRIGHTNESS = (0.95, 0.8, 0.68)
"""How bright faces are: level ones, those that look along x, and those that look along y."""

UNLIT_EXTENSION = "KHR_materials_unlit"
_GAMMA = 2.2
_JSON_CHUNK = 0x4E4F534A


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
