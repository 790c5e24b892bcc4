"""Scenes for drawing on the page: cut open like a doll's house, with shading that is computed in advance.

The page itself computes no lighting. A browser without a GPU draws a lit scene many times slower than a scene with
fixed shading; and with fixed shading, the scene looks like the robot's camera images. The shading is stored in the
vertices. If it were stored in the textures, each texture would need three copies, and the page would draw three times
as many parts. The top face of each solid object is lowered to the height of the cut, as a lid.
"""

import json
import struct
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.rendering.floor_picture import floor_picture
from ltvn_core.simulation.scene_glb import CORNER_LIGHT, to_glb
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light, Surfaces, joined
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Rgb
from ltvn_core.worlds import AS_MADE, OWN_PREFIX, ThingKind, WorldState

FACE_BRIGHTNESS = (0.95, 0.8, 0.68)
"""Brightness of faces by their orientation: horizontal, normal along x, and normal along y."""
PICTURE_PX = 2048
"""Length of the longer side of a scene's picture from above, in pixels."""
UNLIT_EXTENSION = "KHR_materials_unlit"
_GAMMA = 2.2
_JSON_CHUNK = 0x4E4F534A


def without_guests(state: WorldState) -> WorldState:
    """Return a state of a scene without what `added_glb` draws of it."""
    own = tuple(each for each in state.things if each.kind is ThingKind.FURNITURE)
    return replace(state, closed_doors=frozenset(), things=own, people=())


class FloorPicture(NamedTuple):
    """A scene from straight above, and its extent."""

    rgb: Rgb
    """Picture (H, W, 3) with x to the right and y up."""
    low: NDArray[np.floating]
    """Corner (2,) with the least x and y, in metres."""
    high: NDArray[np.floating]
    """Corner (2,) with the largest x and y, in metres."""


def scene_glb(name: str, state: WorldState = AS_MADE) -> bytes:
    """Return a scene as binary glTF, cut open and with fixed shading; raises SceneError for an unknown scene.

    It does not contain the doors that are closed in `state`, nor its objects and people.
    """
    return marked_unlit(_own_glb(name, _bare(state)), Light.of(state.light.level, state.light.warmth))


def added_glb(name: str, state: WorldState) -> bytes | None:
    """Return the doors, objects and people that `state` adds to a scene, as binary glTF; None if it adds nothing.

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
    return _glb(_cut_scene(name, state))


@lru_cache(maxsize=2)
def _cut_scene(name: str, state: WorldState) -> Surfaces:
    scene = load_scene(name) if state == AS_MADE else _scenes(name).at(state)
    return cut_away(scene.surfaces)


def _bare(state: WorldState) -> WorldState:
    """Return the part of a state that belongs to the scene itself, without closed doors, added objects, people, and
    light."""
    own = tuple(each for each in state.things if each.thing.startswith(OWN_PREFIX))
    return replace(AS_MADE, things=own, missing=state.missing, pictures=state.pictures)


@lru_cache(maxsize=2)
def _scenes(name: str) -> ChangedScenes:
    return ChangedScenes(load_scene(name))


def _glb(surfaces: Surfaces) -> bytes:
    return to_glb(surfaces, face_light(surfaces))


def scene_picture(name: str, state: WorldState = AS_MADE) -> FloorPicture | None:
    """Return a picture of a scene from above, for pages that draw slowly; None if Embree is not installed.

    The picture shows the moved furniture, the pictures on the floor and the light of `state`. States that agree in
    these share one picture. Raises SceneError for an unknown scene.
    """
    return _lit_picture(name, _bare(state), Light.of(state.light.level, state.light.warmth))


@lru_cache(maxsize=4)
def _lit_picture(name: str, state: WorldState, light: Light) -> FloorPicture | None:
    picture = _own_picture(name, state)
    if picture is None or light == PLAIN_LIGHT:
        return picture
    return picture._replace(rgb=np.rint(picture.rgb * _shown_share(light)).astype(np.uint8))


@lru_cache(maxsize=4)
def _own_picture(name: str, state: WorldState) -> FloorPicture | None:
    surfaces = _cut_scene(name, state)
    low = surfaces.vertices[:, :2].min(axis=0)
    high = surfaces.vertices[:, :2].max(axis=0)
    try:
        return FloorPicture(floor_picture(surfaces, low, high, most_px=PICTURE_PX), low, high)
    except ImportError:
        return None


def floor_bounds(name: str) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return the corners (x_m, y_m) of a scene with the least and the largest coordinates; None for an unknown
    scene."""
    try:
        vertices, _ = load_scene(name).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)


def face_light(surfaces: Surfaces) -> NDArray[np.floating]:
    """Return the share of light that each face reflects (F,), in [0, 1], by its orientation."""
    a, b, c = np.moveaxis(surfaces.vertices[surfaces.faces], 1, 0)
    normal = np.abs(np.cross(b - a, c - a))
    shade = np.select([normal[:, 2] >= normal[:, :2].max(axis=1), normal[:, 0] >= normal[:, 1]], [0, 1], 2)
    # FACE_BRIGHTNESS is perceived brightness; glTF needs linear light.
    return np.asarray(FACE_BRIGHTNESS)[shade] ** _GAMMA


def _shown_share(light: Light) -> NDArray[np.float64]:
    """Return the perceived brightness of red, green and blue on the page (3,), as shares in [0, 1].

    A dark scene is drawn brighter than the camera sees it, so that a person can still recognise it. No factor exceeds
    1.
    """
    return np.minimum(light, 1.0) ** 0.5


def marked_unlit(glb: bytes, light: Light = PLAIN_LIGHT) -> bytes:
    """Mark all materials of a binary glTF as unlit, so that their textures are shown as they are, in the colour of
    `light`.

    The shading of faces that `to_glb` wrote becomes their vertex colour.
    """
    (length,) = struct.unpack_from("<I", glb, 12)
    described = parse_json(glb[20 : 20 + length])
    for part in (part for mesh in described["meshes"] for part in mesh["primitives"]):
        if CORNER_LIGHT in part["attributes"]:
            part["attributes"]["COLOR_0"] = part["attributes"].pop(CORNER_LIGHT)
    for material in described["materials"]:
        material.setdefault("extensions", {})[UNLIT_EXTENSION] = {}
        if light != PLAIN_LIGHT:
            # glTF factors are linear light; textures store perceived brightness.
            factors = (_shown_share(light) ** _GAMMA).tolist()
            material.setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = [*factors, 1.0]
    described["extensionsUsed"] = sorted({*described.get("extensionsUsed", ()), UNLIT_EXTENSION})
    text = json.dumps(described, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # glTF needs chunks whose length is a multiple of four bytes.
    body = struct.pack("<II", len(text), _JSON_CHUNK) + text + glb[20 + length :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


CUT_HEIGHT_M = 1.35
"""Height in metres at which walls are cut: above tables, window sills and the robot, but low enough to look over."""
MIN_LID_NORMAL_Z = 0.95
"""Least upward component of the unit normal of a face that becomes a lid."""
LID_SQUEEZE = 0.01
"""Factor for the height differences of lids; it is not zero, because lids at the same height flicker."""

Corners = NDArray[np.float32]
"""Position and texture coordinates of each corner of faces, shape (F, 3, 5)."""


def cut_away(surfaces: Surfaces, height_m: float = CUT_HEIGHT_M) -> Surfaces:
    """Return surfaces without the parts above `height_m`, closed by lids."""
    shown = surfaces.without_overhead()
    corners = np.concatenate([shown.vertices[shown.faces], shown.corner_uv], axis=2)
    above = (corners[:, :, 2] > height_m).sum(axis=1)
    lids = _lids(corners, above == 3, height_m)
    one = above == 1
    two = above == 2
    one_high = _turned(corners[one], corners[one][:, :, 2] > height_m)
    one_low = _turned(corners[two], corners[two][:, :, 2] <= height_m)
    parts = [
        (corners[above == 0], shown.face_texture[above == 0]),
        (_below_one_high(one_high, height_m), np.tile(shown.face_texture[one], 2)),
        (_below_two_high(one_low, height_m), shown.face_texture[two]),
        (lids[0], shown.face_texture[lids[1]]),
    ]
    kept, textures = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Surfaces(
        vertices=kept[:, :, :3].reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * len(kept), dtype=np.int32).reshape(-1, 3),
        corner_uv=kept[:, :, 3:].astype(np.float32),
        face_texture=textures.astype(np.int32),
        overhead=np.zeros(len(kept), bool),
        textures=surfaces.textures,
    )


def _lids(corners: Corners, high: NDArray[np.bool_], height_m: float) -> tuple[Corners, NDArray[np.int64]]:
    """Return the top faces above the cut, lowered to lids, and their row numbers."""
    edges = corners[:, 1:, :3] - corners[:, :1, :3]
    normal = np.cross(edges[:, 0], edges[:, 1])
    upward = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    rows = np.flatnonzero(high & (upward > MIN_LID_NORMAL_Z))
    lids = corners[rows].copy()
    lids[:, :, 2] = height_m + LID_SQUEEZE * (lids[:, :, 2] - height_m)
    return lids, rows


def _turned(corners: Corners, is_odd: NDArray[np.bool_]) -> Corners:
    """Rotate the corners of each triangle until its odd corner is first; the orientation stays."""
    order = (np.argmax(is_odd, axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(corners, order[:, :, None], axis=1)


def _between(low: NDArray[np.float32], high: NDArray[np.float32], height_m: float) -> NDArray[np.float32]:
    """Return the points where the edges (F, 5) from `low` to `high` reach the height."""
    share = (height_m - low[:, 2]) / (high[:, 2] - low[:, 2])
    return (low + share[:, None] * (high - low)).astype(np.float32)


def _below_one_high(corners: Corners, height_m: float) -> Corners:
    """Cut off the first corner; the rest of each triangle becomes two triangles."""
    top = corners[:, 0]
    left = corners[:, 1]
    right = corners[:, 2]
    on_left = _between(left, top, height_m)
    on_right = _between(right, top, height_m)
    return np.concatenate([np.stack([on_left, left, right], axis=1), np.stack([on_left, right, on_right], axis=1)])


def _below_two_high(corners: Corners, height_m: float) -> Corners:
    """Keep the part of each triangle at its first corner."""
    bottom = corners[:, 0]
    left = corners[:, 1]
    right = corners[:, 2]
    return np.stack([bottom, _between(bottom, left, height_m), _between(bottom, right, height_m)], axis=1)


def add_lights(scene: viser.SceneApi) -> None:
    """Light the objects that have no fixed shading."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map("warehouse", environment_intensity=0.35)
