"""How a scene is made ready for the page: walls cut at a height, surfaces painted with baked shading."""

import io
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from ltvn_core.simulation.scene_glb import to_glb
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.worlds import AS_MADE, LightChanged
from ltvn_viz.layers.scene_assets import cut_away, face_light, marked_unlit, scene_picture


def a_box(low: float, high: float) -> Surfaces:
    """Return a textured box between two heights."""
    vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (low, high)], np.float32)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    uv = vertices[np.array(faces)][:, :, [0, 2]]
    none = np.zeros(12, bool)
    return Surfaces(
        vertices, np.array(faces, np.int32), uv, np.zeros(12, np.int32), none, (np.zeros((1, 1, 3), np.uint8),)
    )


def json_of(glb: bytes) -> dict[str, Any]:
    """Return the description in a binary glTF."""
    return json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])


def area(surfaces: Surfaces) -> float:
    a, b, c = np.moveaxis(surfaces.vertices[surfaces.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_what_is_low_is_not_cut() -> None:
    assert area(cut_away(a_box(0.0, 1.0), height_m=1.35)) == pytest.approx(6.0)


def test_a_tall_box_is_cut_at_the_height_and_closed_by_its_lid() -> None:
    cut = cut_away(a_box(0.0, 3.0), height_m=1.0)
    assert area(cut) == pytest.approx(6.0, rel=0.05)
    assert cut.vertices[:, 2].max() < 1.05


def test_the_picture_on_a_wall_is_cut_and_not_squeezed() -> None:
    cut = cut_away(a_box(0.0, 3.0), height_m=1.0)
    sides = np.ptp(cut.vertices[cut.faces][:, :, 2], axis=1) > 0.1
    np.testing.assert_allclose(cut.corner_uv[sides][:, :, 1], cut.vertices[cut.faces][sides][:, :, 2], atol=1e-5)


def test_faces_are_darker_by_where_they_look_and_share_their_texture() -> None:
    box = replace(a_box(0.0, 1.0), textures=(np.full((1, 1, 3), 200, np.uint8),))
    described = json_of(marked_unlit(to_glb(box, face_light(box))))
    (mesh,) = described["meshes"]
    (part,) = mesh["primitives"]
    corners = described["accessors"][part["attributes"]["COLOR_0"]]
    assert (corners["type"], corners["count"]) == ("VEC3", 3 * len(box.faces))
    assert len(described["images"]) == 1
    light = face_light(box)
    assert len(set(light.tolist())) == 3
    assert light[np.ptp(box.vertices[box.faces][:, :, 2], axis=1) == 0].min() == light.max()


def test_a_painted_scene_is_a_whole_gltf_without_lit_materials() -> None:
    glb = marked_unlit(to_glb(a_box(0.0, 1.0)))
    assert len(glb) == int.from_bytes(glb[8:12], "little")
    described = json_of(glb)
    assert all("KHR_materials_unlit" in material["extensions"] for material in described["materials"])
    scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    assert scene.area == pytest.approx(6.0)


def test_a_page_that_draws_the_scene_from_above_shows_its_light() -> None:
    pytest.importorskip("embreex")
    bright = scene_picture("apartment-57")
    dark = scene_picture("apartment-57", replace(AS_MADE, light=LightChanged(0.25)))
    warm = scene_picture("apartment-57", replace(AS_MADE, light=LightChanged(0.5, 1.0)))
    assert bright is not None
    assert dark is not None
    assert warm is not None
    assert dark.rgb.mean() == pytest.approx(bright.rgb.mean() / 2, rel=0.02)
    tint = warm.rgb.mean(axis=(0, 1)) / bright.rgb.mean(axis=(0, 1))
    assert tint[0] > tint[1] > tint[2]
