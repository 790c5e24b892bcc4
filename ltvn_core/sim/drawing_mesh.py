"""Surfaces as a binary glTF, for drawing them elsewhere."""

import io
from typing import cast

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from ltvn_core.sim.surfaces import Surfaces


def to_glb(surfaces: Surfaces) -> bytes:
    """Return a glTF with one mesh per texture, z up, textures as JPEG."""
    scene = trimesh.Scene()
    for texture in np.unique(surfaces.face_texture):
        scene.add_geometry(
            _part(surfaces.only(surfaces.face_texture == texture), int(texture)), geom_name=f"part{texture}"
        )
    return cast(bytes, scene.export(file_type="glb"))


def _part(surfaces: Surfaces, texture: int) -> trimesh.Trimesh:
    corners = surfaces.vertices[surfaces.faces].reshape(-1, 3)
    material = PBRMaterial(
        baseColorTexture=_compressed(surfaces.textures[texture]),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    visual = TextureVisuals(uv=surfaces.corner_uv.reshape(-1, 2), material=material)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)


def _compressed(texture: np.ndarray) -> Image.Image:
    """Let the picture go through JPEG, so that the glTF holds it small."""
    buffer = io.BytesIO()
    Image.fromarray(texture).save(buffer, "JPEG", quality=85)
    return Image.open(buffer)
