"""Meshes as other programs pack them: compressed, of integers, or without their pictures."""

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from ltvn_core.errors import SceneError
from ltvn_core.simulation.meshes import mesh_file
from ltvn_core.simulation.meshes.mesh_file import read_mesh
from tests.core.simulation.two_room_mesh import box_house, save


def triangle_soup() -> tuple[np.ndarray, np.ndarray]:
    house: Any = box_house(up="y").to_mesh()
    return np.asarray(house.vertices, np.float32), np.asarray(house.faces, np.uint32)


def write_glb(path: Path, header: dict[str, Any], binary: bytes) -> Path:
    text = json.dumps({"asset": {"version": "2.0"}, "scene": 0, **header}).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def write_integers(path: Path, *, signed: bool) -> tuple[Path, np.ndarray]:
    """Write a house of 16-bit integers as `gltfpack` does; return it with its true corners."""
    vertices, faces = triangle_soup()
    low, span = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    one = 32767 if signed else 65535
    rows = np.zeros((len(vertices), 4), "<i2" if signed else "<u2")
    rows[:, :3] = np.rint((vertices - low) / span * one)
    views = [{"buffer": 0, "byteLength": faces.nbytes}]
    views.append({"buffer": 0, "byteOffset": faces.nbytes, "byteLength": rows.nbytes, "byteStride": 8})
    kind = 5122 if signed else 5123
    corners = {"bufferView": 1, "componentType": kind, "normalized": True, "count": len(vertices), "type": "VEC3"}
    header = {
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [span] * 3, "translation": low.tolist()}],
        # Two primitives share their corners, which must be scaled once.
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * 2}],
        "accessors": [corners, {"bufferView": 0, "componentType": 5125, "count": faces.size, "type": "SCALAR"}],
        "buffers": [{"byteLength": faces.nbytes + rows.nbytes}],
        "bufferViews": views,
        "extensionsRequired": ["KHR_mesh_quantization"],
    }
    return write_glb(path, header, faces.tobytes() + rows.tobytes()), vertices


@pytest.mark.parametrize("corner", [np.nan, np.inf])
def test_triangles_with_a_corner_that_is_no_number_are_left_out_and_counted(tmp_path: Path, corner: float) -> None:
    vertices, faces = triangle_soup()
    vertices[faces[[3, 8]], 1] = corner
    path = tmp_path / "house.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines), encoding="utf-8")
    content = read_mesh(path)
    (doubt,) = content.doubts
    assert np.isfinite(content.surfaces.vertices).all()
    assert f" {len(faces) - len(content.surfaces.faces)} of {len(faces)} triangles" in doubt


@pytest.mark.parametrize("signed", [False, True])
def test_integers_that_stand_for_shares_of_one_are_scaled(tmp_path: Path, signed: bool) -> None:
    path, vertices = write_integers(tmp_path / "house.glb", signed=signed)
    content = read_mesh(path)
    read = content.surfaces.vertices
    assert np.allclose(read.min(axis=0), vertices.min(axis=0), atol=1e-3)
    assert np.allclose(read.max(axis=0), vertices.max(axis=0), atol=1e-3)
    assert content.doubts == ()


def test_a_mesh_that_is_compressed_with_draco_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("DracoPy")
    house = box_house(up="y")
    path = tmp_path / "house.glb"
    path.write_bytes(export_glb(house, extension_draco=True))
    assert b"KHR_draco_mesh_compression" in path.read_bytes()
    read = read_mesh(path).surfaces.vertices
    assert np.allclose([read.min(axis=0), read.max(axis=0)], house.bounds, atol=0.01)

    monkeypatch.setattr(mesh_file, "is_installed", lambda _: False)
    with pytest.raises(SceneError, match=r"pip install 'ltvn\[sim\]'"):
        read_mesh(path)


def test_damaged_draco_is_not_taken_for_a_mesh_without_triangles(tmp_path: Path) -> None:
    pytest.importorskip("DracoPy")
    path = tmp_path / "house.glb"
    data = export_glb(box_house(up="y"), extension_draco=True)
    path.write_bytes(data.replace(b"DRACO", b"OCARD"))
    with pytest.raises(SceneError, match="Draco and damaged"):
        read_mesh(path)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_a_compression_that_is_not_read_is_named_with_the_way_out(tmp_path: Path, name: str) -> None:
    path = write_glb(tmp_path / "house.glb", {"extensionsRequired": [name], "scenes": [{}]}, b"")
    with pytest.raises(SceneError, match=rf"{name}.*gltf-transform/cli cp"):
        read_mesh(path)


def test_textures_in_ktx2_and_unknown_extensions_are_doubts(tmp_path: Path) -> None:
    path = save(box_house("texture", up="y"), tmp_path / "house.glb")
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    header = json.loads(data[20 : 20 + length])
    for image in header["images"]:
        image["mimeType"] = "image/ktx2"
    header["extensionsRequired"] = ["KHR_texture_basisu", "XYZ_moss"]
    write_glb(path, header, data[28 + length :])
    doubts = read_mesh(path).doubts
    assert "KTX2" in doubts[0]
    assert "XYZ_moss" in doubts[1]


def textured_obj(folder: Path, reference: str) -> Path:
    folder.mkdir()
    cv2.imwrite(str(folder / "Old Wall.png"), np.full((4, 4, 3), (30, 60, 90), np.uint8))
    (folder / "house.mtl").write_text(f"newmtl wall\nKd 1 1 1\nmap_Kd {reference}\n", encoding="utf-8")
    path = folder / "house.obj"
    path.write_text(
        "mtllib house.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wall\nf 1/1 2/2 3/3\n",
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize(
    "reference",
    ["Old Wall.png", "Old%20Wall.png", r"C:\Users\me\my scan\old wall.PNG", "/home/me/Old Wall.png"],
)
def test_a_picture_is_found_beside_the_mesh_whatever_path_it_had_elsewhere(tmp_path: Path, reference: str) -> None:
    content = read_mesh(textured_obj(tmp_path / "scan", reference))
    assert content.surfaces.textures[0].reshape(-1, 3).mean(axis=0).tolist() == [90, 60, 30]
    assert content.doubts == ()


@pytest.mark.parametrize("lost", ["house.mtl", "Old Wall.png"])
def test_a_lost_picture_or_material_library_is_named(tmp_path: Path, lost: str) -> None:
    path = textured_obj(tmp_path / "scan", "Old Wall.png")
    (path.parent / lost).unlink()
    (doubt,) = read_mesh(path).doubts
    assert lost in doubt


def coloured_box(*, textured: bool) -> trimesh.Scene:
    """A red box whose colour is at its vertices, beside a white material."""
    box = trimesh.creation.box()
    image = Image.new("RGB", (4, 4), (0, 0, 255)) if textured else None
    material = PBRMaterial(baseColorFactor=[255, 255, 255, 255], baseColorTexture=image)
    uv = np.zeros((len(box.vertices), 2)) if textured else None
    box.visual = TextureVisuals(uv=uv, material=material)
    box.visual.vertex_attributes["color"] = np.tile(np.array([255, 0, 0, 255], np.uint8), (len(box.vertices), 1))
    return trimesh.Scene(box)


def with_colours(path: Path, *, textured: bool) -> Path:
    """Write the box as glTF with COLOR_0."""
    path.write_bytes(export_glb(coloured_box(textured=textured)))
    assert b"COLOR_0" in path.read_bytes()
    return path


def test_vertex_colours_beside_a_material_are_shown(tmp_path: Path) -> None:
    content = read_mesh(with_colours(tmp_path / "box.glb", textured=False))
    assert any((texture.reshape(-1, 3) == (255, 0, 0)).all(-1).any() for texture in content.surfaces.textures)
    assert not content.doubts


def test_vertex_colours_that_a_texture_hides_are_doubted(tmp_path: Path) -> None:
    assert any("vertices" in doubt for doubt in read_mesh(with_colours(tmp_path / "box.glb", textured=True)).doubts)


def test_vertex_colours_of_an_obj_file_with_a_material_are_shown_or_doubted(tmp_path: Path) -> None:
    path = tmp_path / "box.obj"
    path.write_text(
        "mtllib box.mtl\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nusemtl white\nf 1 2 3\n", encoding="utf-8"
    )
    (tmp_path / "box.mtl").write_text("newmtl white\nKd 1 1 1\n", encoding="utf-8")
    content = read_mesh(path)
    shown = any((texture.reshape(-1, 3) == (255, 0, 0)).all(-1).any() for texture in content.surfaces.textures)
    assert shown or any("vertices" in doubt for doubt in content.doubts)
