"""Surfaces as a binary glTF file; apart from `scene`, because few programs need trimesh, which takes long to import."""

import io
from typing import cast

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from ltvn_core.simulation.surfaces import Surfaces, shrink_to_budget
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
    # As JPEG, because trimesh embeds an image in its own format, and PNG is several times larger.
    Image.fromarray(image).save(compressed := io.BytesIO(), "JPEG", quality=85)
    material = PBRMaterial(
        baseColorTexture=Image.open(compressed),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    visual = TextureVisuals(uv=surfaces.corner_uv.reshape(-1, 2), material=material)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)
