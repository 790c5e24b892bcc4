"""Converts the colours of meshes to textures: images, plain materials, and colours of vertices or faces.

Handles the sizes of textures, the palette for vertex colours, and the colour factors of glTF.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from ltvn_core.simulation.surfaces import resize_to_power_of_two, shrink_to_budget
from ltvn_core.types import Rgb

MAX_TEXELS = 24_000_000
"""Limit for all textures together; the largest are halved until they fit, because each texel costs the renderer 16
bytes of memory."""

GREY = (200, 200, 200)
"""Colour if the file sets none."""

_SMOOTH_STEP = 20
"""A face whose corners differ by more than this in one channel is subdivided, because the palette gives each face one
colour."""
_DIVISIONS = 5
"""Maximum number of subdivisions, each into four faces."""


class TexturedTriangles(NamedTuple):
    """Triangles with their texture coordinates and textures."""

    triangles: NDArray[np.float64]
    """(F, 3, 3) corners in the frame of the mesh."""
    corner_uv: NDArray[np.float32]
    """(F, 3, 2) texture coordinates of the corners."""
    face_texture: NDArray[np.int32]
    """(F,) indices of textures."""


class TextureCollector:
    """Collects the textures of all meshes of a file, each image once."""

    def __init__(self, *, linear_factors: bool) -> None:
        """Create an empty collection.

        Args:
            linear_factors: Whether colours of materials are linear light, as in glTF, and not sRGB.
        """
        self._linear = linear_factors
        self.without_vertex_colours = 0
        """Number of meshes whose vertex colours are not used, because they have a texture."""
        self._images: list[Rgb] = []
        self._known: dict[Any, int] = {}
        self._alive: list[Image.Image] = []  # Images are identified by id(), so none may be freed meanwhile.

    def add_mesh(self, mesh: trimesh.Trimesh) -> TexturedTriangles:
        """Add the textures of a mesh and return its triangles with them."""
        visual: Any = mesh.visual
        if visual.kind in ("vertex", "face"):
            return self._texture_from_palette(*_divided(mesh))
        uv = _usable_uv(mesh) if visual.kind == "texture" else None
        material = getattr(visual, "material", None)
        if (colours := _vertex_colours(mesh)) is not None:
            if uv is None or _image_of(material) is None:
                return self._texture_from_palette(*_divided(mesh, colours))
            self.without_vertex_colours += 1
        corner_uv = np.zeros((len(mesh.faces), 3, 2), np.float32) if uv is None else uv[mesh.faces].astype(np.float32)
        texture = self._texture_of(material, with_image=uv is not None)
        return TexturedTriangles(mesh.vertices[mesh.faces], corner_uv, np.full(len(mesh.faces), texture, np.int32))

    @property
    def has_palette(self) -> bool:
        """Whether a mesh got the colours of its vertices or faces."""
        return "palette" in self._known

    def textures(self) -> tuple[Rgb, ...]:
        """Return all textures, with sides that are powers of two."""
        return tuple(shrink_to_budget([resize_to_power_of_two(image) for image in self._images], MAX_TEXELS))

    def _texture_of(self, material: Any, *, with_image: bool) -> int:
        image = _image_of(material)
        factor = _factor_of(material)
        if image is None or not with_image:
            colour = self._srgb_colour(factor) if factor is not None else GREY
            return self._add(colour, np.array([[colour]], np.uint8))
        key = (id(image), None if factor is None else tuple(factor))
        if key not in self._known:
            self._alive.append(image)
            texels = _opaque(image)
            self._add(key, texels if factor is None else self._tinted(texels, factor))
        return self._known[key]

    def _add(self, key: Any, image: Rgb) -> int:
        if key not in self._known:
            self._known[key] = len(self._images)
            self._images.append(image)
        return self._known[key]

    def _srgb_colour(self, factor: NDArray[np.uint8]) -> tuple[int, ...]:
        return tuple(int(value) for value in (_encoded(factor / 255) if self._linear else factor))

    def _tinted(self, texels: Rgb, factor: NDArray[np.uint8]) -> Rgb:
        if (factor == 255).all():
            return texels
        levels = np.arange(256) / 255
        if self._linear:
            table = np.stack([_encoded(_decoded(levels) * share) for share in factor / 255], axis=-1)
        else:
            table = np.stack([np.rint(255 * levels * share).astype(np.uint8) for share in factor / 255], axis=-1)
        return np.asarray(cv2.LUT(texels, table[None]), np.uint8)

    def _texture_from_palette(self, triangles: NDArray[np.float64], colours: NDArray[np.float64]) -> TexturedTriangles:
        """Map each face (F, 3, 3) to one texel of a palette, by the colours (F, 3, 3) of its corners.

        Neighbouring texels do not bleed in, because the mip-map level of a face without texture extent is 0.
        """
        red, green, blue = np.clip((colours.mean(1) / 255 * _STEPS).round().astype(int), 0, _STEPS).T
        column = red % 8 * 32 + blue
        row = red // 8 * 64 + green
        uv = np.column_stack([(column + 0.5) / 256, 1 - (row + 0.5) / 256]).astype(np.float32)
        texture = self._add("palette", _palette())
        return TexturedTriangles(
            triangles, np.repeat(uv[:, None], 3, axis=1), np.full(len(triangles), texture, np.int32)
        )


_STEPS = np.array([31, 63, 31])
"""Steps of red, green and blue in the palette."""


def _palette() -> Rgb:
    row, column = np.mgrid[:256, :256]
    red = row // 64 * 8 + column // 32
    green = row % 64
    blue = column % 32
    return np.rint(np.stack([red, green, blue], -1) * 255 / _STEPS).astype(np.uint8)


def _vertex_colours(mesh: trimesh.Trimesh) -> NDArray[np.float64] | None:
    """Return the colours (N, 3) from 0 to 255 of the vertices of a mesh that has a material too; None if there are none
    or all are white."""
    found = getattr(mesh.visual, "vertex_attributes", {}).get("color")
    if found is None or len(found) != len(mesh.vertices):
        return None
    colours = np.asarray(found)[:, :3]
    largest = {"f": 1.0, "u": 255.0 if colours.dtype.itemsize == 1 else 65_535.0}.get(colours.dtype.kind, 255.0)
    scaled = np.clip(np.nan_to_num(colours.astype(float)) * (255 / largest), 0, 255)
    return None if (scaled >= 254.5).all() else scaled


def _divided(
    mesh: trimesh.Trimesh, own: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return triangles (F, 3, 3) and corner colours (F, 3, 3), subdivided where the colour varies within a face.

    `own` are the colours (N, 3) of the vertices if the mesh itself does not know them.
    """
    visual: Any = mesh.visual
    if own is None and visual.kind == "face":
        colours = np.asarray(visual.face_colors)[:, :3].astype(float)
        return mesh.vertices[mesh.faces], np.repeat(colours[:, None], 3, axis=1)
    vertices = np.asarray(mesh.vertices)
    faces = np.asarray(mesh.faces)
    colours = np.asarray(visual.vertex_colors)[:, :3].astype(float) if own is None else own
    for _ in range(_DIVISIONS):
        coarse = np.flatnonzero(np.ptp(colours[faces], axis=1).max(axis=1) > _SMOOTH_STEP)
        if len(coarse) == 0 or len(coarse) > 200_000:
            break  # A mesh with this many faces is a scan, whose faces are small enough already.
        divided: Any = trimesh.remesh.subdivide(vertices, faces, coarse, {"colour": colours})
        vertices = divided[0]
        faces = divided[1]
        colours = divided[2]["colour"]
    return vertices[faces], colours[faces]


def _usable_uv(mesh: trimesh.Trimesh) -> NDArray[np.float64] | None:
    uv = getattr(mesh.visual, "uv", None)
    if uv is None or len(uv) != len(mesh.vertices):
        return None
    return np.nan_to_num(np.asarray(uv, np.float64)[:, :2], posinf=0.0, neginf=0.0)


def _image_of(material: Any) -> Image.Image | None:
    for name in ("baseColorTexture", "image"):
        image = getattr(material, name, None)
        if isinstance(image, Image.Image):
            return image
    return None


def _factor_of(material: Any) -> NDArray[np.uint8] | None:
    """Return the colour (3,) of a material, or None.

    The diffuse colour of a material with an image is ignored, because OBJ files often set it to black or grey.
    """
    factor = getattr(material, "baseColorFactor", None)
    if factor is None and _image_of(material) is None:
        factor = getattr(material, "diffuse", None)
    if factor is None:
        return None
    factor = np.asarray(factor)
    scale = 255 if factor.dtype.kind == "f" and factor.max(initial=0) <= 1 else 1
    return np.clip(np.rint(factor[:3] * scale), 0, 255).astype(np.uint8)


def _opaque(image: Image.Image) -> Rgb:
    """Blend an image over grey, because the colour of transparent pixels is arbitrary."""
    if image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info:
        behind = Image.new("RGBA", image.size, (*GREY, 255))
        image = Image.alpha_composite(behind, image.convert("RGBA"))
    return np.asarray(image.convert("RGB"))


def _encoded(light: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Turn linear light in [0, 1] into sRGB bytes."""
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return np.clip(np.rint(255 * curve), 0, 255).astype(np.uint8)


def _decoded(levels: NDArray[np.floating]) -> NDArray[np.floating]:
    """Turn sRGB levels in [0, 1] into linear light."""
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
