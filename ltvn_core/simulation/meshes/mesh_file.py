"""Reads triangles and textures from a mesh file (GLB, glTF, OBJ, PLY), and finds the files that it refers to.

The JSON of a glTF file is prepared for trimesh: unsupported compressions are rejected, and normalised integers
(`KHR_mesh_quantization`) are marked, because trimesh does not scale them. Trimesh decodes Draco if DracoPy is
installed. Coordinates stay those of the file; `mesh_alignment` finds the upward axis and the unit.
"""

import base64
import io
import json
import struct
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.gltf.extensions import register_handler
from trimesh.resolvers import FilePathResolver

from ltvn_core.errors import SceneError
from ltvn_core.extras import is_installed, missing_text
from ltvn_core.simulation.meshes.mesh_textures import TextureCollector
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.structured_text import parse_json

GLTF_SUFFIXES = (".glb", ".gltf")
_DRACO = "KHR_draco_mesh_compression"
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_BASIS = "KHR_texture_basisu"
_READ = (_DRACO, _BASIS, "KHR_mesh_quantization", "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness")
_NORMALISED = "LTVN_normalised"
"""Name of the extension that marks a primitive. It maps accessors with normalised integers to the integer that means
1."""
_ONE = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
"""Component type -> the integer that means 1."""
_MAGIC = b"glTF"
_JSON = b"JSON"
_KTX2 = b"\xabKTX 20\xbb"
FORMATS = (".glb", ".gltf", ".obj", ".ply")
_SEARCHED_LINES = 10_000
"""Number of lines of an OBJ file in which its first vertex is searched."""
_NAMED = 5
"""Maximum number of missing files in a message."""


class AssetFinder(FilePathResolver):
    """Finds a file by its path in the mesh, or else by its bare name in the folder of the mesh.

    Meshes from other machines refer to textures by paths on those machines, including Windows paths.
    """

    def __init__(self, mesh: Path) -> None:
        """Search in the folder of a mesh."""
        super().__init__(str(mesh))
        self.missing: list[str] = []
        """Names of files that were not found."""

    def get(self, name: str) -> Any:
        """Return the bytes of a file. Raises OSError if it does not exist."""
        plain = unquote(name)  # Names in glTF are parts of URLs: a space is %20.
        for candidate in (name, plain, *self._beside(plain)):
            try:
                return super().get(candidate)
            except (OSError, ValueError):
                continue
        if name not in self.missing:
            self.missing.append(name)
        raise FileNotFoundError(name)

    def _beside(self, name: str) -> list[str]:
        """Return the files in the mesh's folder with the same bare name, ignoring case."""
        bare = name.replace("\\", "/").rpartition("/")[2].strip()
        wanted = [bare.lower()]
        if " " in bare:
            wanted.append(bare.split()[-1].lower())  # In a material library, options come before the file name.
        files = sorted(each.name for each in Path(self.parent).iterdir() if each.is_file())
        return [file for each in wanted for file in files if file.lower() == each]


@dataclass(frozen=True, eq=False)
class GltfFile:
    """The JSON of a glTF file, and the bytes that follow it."""

    path: Path
    header: Mapping[str, Any]
    rest: bytes | None
    """The chunks after the JSON of a GLB; None for a glTF of text."""

    @classmethod
    def read(cls, path: Path) -> "GltfFile | None":
        """Read a file; None if its JSON cannot be read, which trimesh reports in more detail."""
        try:
            data = path.read_bytes()
            rest = None
            if data[:4] == _MAGIC:
                length, kind = struct.unpack("<I4s", data[12:20])
                if kind != _JSON:
                    return None
                data, rest = data[20 : 20 + length], data[20 + length :]
            header = parse_json(data)
        except (OSError, ValueError, struct.error):
            return None
        return cls(path, header, rest) if isinstance(header, dict) else None

    def require_readable(self) -> None:
        """Raise SceneError for an unsupported compression; its message says what to do."""
        required = self._required()
        way_out = f"`npx @gltf-transform/cli cp {self.path.name} plain.glb` writes an uncompressed copy"
        for name in _MESHOPT:
            if name in required:
                raise SceneError(f"{self.path} is compressed with meshopt ({name}), which is not supported. {way_out}.")
        if _DRACO in required and not is_installed("DracoPy"):
            raise SceneError(f"{self.path} is compressed with Draco. {missing_text('DracoPy')} Or {way_out}.")

    @property
    def is_draco(self) -> bool:
        """Whether the triangles are stored with Draco compression only."""
        return _DRACO in self._required()

    def with_marked_integers(self) -> bytes | None:
        """Return the file with marks at normalised integers, so that trimesh scales them; None without such
        integers."""
        accessors = self.header.get("accessors", [])
        ones = {
            str(place): _ONE[each["componentType"]]
            for place, each in enumerate(accessors)
            if each.get("normalized") and each.get("componentType") in _ONE
        }
        marked = json.loads(json.dumps(self.header))
        count = 0
        for primitive in (each for mesh in marked.get("meshes", []) for each in mesh.get("primitives", [])):
            names = primitive.get("attributes", {})
            mine = [
                str(place) for name, place in names.items() if not name.startswith("COLOR")
            ]  # trimesh scales those.
            if found := {place: ones[place] for place in mine if place in ones}:
                primitive.setdefault("extensions", {})[_NORMALISED] = found
                count += 1
        return self._joined(marked) if count else None

    def texture_doubts(self) -> Iterator[str]:
        """Yield sentences about textures and surfaces that will look different from the description in the file."""
        images = [each for each in self.header.get("images", []) if self._is_ktx2(each)]
        if images:
            yield (
                f"{self.path.name}: {len(images)} of {len(self.header['images'])} textures are in KTX2 (Basis "
                "Universal), which is not supported, so their surfaces are plain. `npx @gltf-transform/cli "
                f"ktxdecompress {self.path.name} plain.glb` converts them to PNG."
            )
        if unread := sorted(self._required() - set(_READ)):
            yield (
                f"{self.path.name} requires {', '.join(unread)}, which is not supported; its surfaces may look "
                "different."
            )

    def _required(self) -> set[str]:
        required = self.header.get("extensionsRequired", [])
        return {each for each in required if isinstance(each, str)} if isinstance(required, list) else set()

    def _is_ktx2(self, image: Mapping[str, Any]) -> bool:
        uri = str(image.get("uri", ""))
        if "base64," in uri:
            return base64.b64decode(uri.partition("base64,")[2][:16] or "")[: len(_KTX2)] == _KTX2
        return image.get("mimeType") == "image/ktx2" or uri.lower().endswith((".ktx2", ".basis"))

    def _joined(self, header: Mapping[str, Any]) -> bytes:
        text = json.dumps(header).encode()
        if self.rest is None:
            return text
        text += b" " * (-len(text) % 4)
        length = 20 + len(text) + len(self.rest)
        return struct.pack("<4sIII4s", _MAGIC, 2, length, len(text), _JSON) + text + self.rest


@register_handler(_NORMALISED, scope="primitive_preprocess")
def _scale(context: Any) -> None:
    """Scale the marked integers of a primitive; integers shared by several primitives are scaled once."""
    accessors = context["accessors"]
    for place, one in context["data"].items():
        numbers = accessors[int(place)]
        if numbers.dtype.kind in "iu":
            accessors[int(place)] = np.maximum(numbers.astype(np.float32) / np.float32(one), -1)


class MeshContent(NamedTuple):
    """The content of a mesh file."""

    surfaces: Surfaces
    """All triangles in the file's own axes and units."""
    doubts: tuple[str, ...]
    """Sentences about missing textures, each with what to do."""


def read_mesh(path: Path) -> MeshContent:
    """Return all triangles of a file, and sentences about missing textures.

    Raises:
        SceneError: The file does not exist, cannot be read or has no triangles.
    """
    if path.suffix.lower() not in FORMATS:
        raise SceneError(f"{path} is not a scene: a mesh ends in {', '.join(FORMATS)}. Export it as one of these.")
    if not path.is_file():
        raise SceneError(f"The scene's file {path} does not exist. Put it there, or give its new path.")
    colours = TextureCollector(linear_factors=path.suffix.lower() in GLTF_SUFFIXES)
    gltf = GltfFile.read(path) if path.suffix.lower() in GLTF_SUFFIXES else None
    if gltf is not None:
        gltf.require_readable()
    finder = AssetFinder(path)
    parts = [_part(mesh, transform, colours) for mesh, transform in _placed_meshes(path, finder, gltf)]
    if sum(len(part.triangles) for part in parts) == 0:
        if gltf is not None and gltf.is_draco:
            raise SceneError(f"{path}: its triangles are compressed with Draco and damaged. Export the scene again.")
        raise SceneError(
            f"{path} contains no triangles, only points or nothing. Export the surfaces of the scene as well."
        )
    triangles = np.concatenate([part.triangles for part in parts])
    surfaces = Surfaces(
        vertices=triangles.reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3),
        corner_uv=np.concatenate([part.corner_uv for part in parts]).astype(np.float32),
        face_texture=np.concatenate([part.face_texture for part in parts]).astype(np.int32),
        overhead=np.zeros(len(triangles), bool),
        textures=colours.textures(),
    )
    doubts = (*_corner_doubts(path, parts), *_doubts(path, finder, gltf), *_vertex_colour_doubts(path, colours))
    return MeshContent(surfaces, doubts)


def _corner_doubts(path: Path, parts: Sequence["_Part"]) -> Iterator[str]:
    """Yield a sentence if triangles were left out because a corner has a coordinate that is not finite."""
    if count := sum(part.without_place for part in parts):
        kept = sum(len(part.triangles) for part in parts)
        yield (
            f"{path.name}: {count} of {kept + count} triangles have a corner at a coordinate that is not finite (NaN "
            "or infinite), and were left out, so floor or walls may have holes. Export the scene again, or remove "
            "these corners in the program that made it."
        )


def _doubts(path: Path, finder: AssetFinder, gltf: GltfFile | None) -> Iterator[str]:
    """Yield a sentence for each problem with the textures of a mesh."""
    if finder.missing:
        names = ", ".join(finder.missing[:_NAMED]) + (" ..." if len(finder.missing) > _NAMED else "")
        yield (
            f"{path.name} names {names}, which is missing in {path.parent}, so its surfaces have plain colours. Put "
            "the file there, under that name."
        )
    if gltf is not None:
        yield from gltf.texture_doubts()


def _vertex_colour_doubts(path: Path, colours: TextureCollector) -> Iterator[str]:
    """Yield a sentence if the colours of vertices are lost."""
    beside = colours.without_vertex_colours > 0
    if beside or (path.suffix.lower() == ".obj" and not colours.has_palette and _has_coloured_vertices(path)):
        yield (
            f"{path.name} has colours at its vertices beside materials, and they are not shown. To see them, bake them "
            "into the textures, or export the mesh without materials."
        )


def _has_coloured_vertices(path: Path) -> bool:
    """Tell by its first vertex whether an OBJ file has colours at its vertices: x y z r g b."""
    with path.open("rb") as file:
        first = next((line for line in islice(file, _SEARCHED_LINES) if line.startswith(b"v ")), b"")
    return len(first.split()) == 7


def _placed_meshes(
    path: Path, finder: AssetFinder, gltf: GltfFile | None
) -> list[tuple[trimesh.Trimesh, NDArray[np.float64]]]:
    """Return each mesh with its transform (4, 4).

    Catches every exception, because the parsers of these formats raise many types for damaged files.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            marked = None if gltf is None else gltf.with_marked_integers()
            source = path.open("rb") if marked is None else io.BytesIO(marked)
            with source:
                scene: Any = trimesh.load_scene(
                    source, file_type=path.suffix[1:].lower(), resolver=finder, process=False
                )
            nodes = map(scene.graph.get, scene.graph.nodes_geometry)
            placed = [(scene.geometry[name], transform) for transform, name in nodes]
    except Exception as error:
        raise SceneError(
            f"{path} cannot be read as a {path.suffix[1:].upper()} mesh ({error or type(error).__name__}). Check that "
            "the file is complete, and that its ending fits its format."
        ) from error
    return [(mesh, transform) for mesh, transform in placed if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]


class _Part:
    """One mesh in the coordinates of the file, without degenerate triangles and those with NaN corners."""

    def __init__(self, triangles: NDArray, corner_uv: NDArray, face_texture: NDArray) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            edges = triangles[:, 1:] - triangles[:, :1]
            doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        whole = np.isfinite(doubled) & (doubled > 0)
        self.without_place = int(np.count_nonzero(~np.isfinite(triangles).all(axis=(1, 2))))
        self.triangles = triangles[whole]
        self.corner_uv = corner_uv[whole]
        self.face_texture = face_texture[whole]


def _part(mesh: trimesh.Trimesh, transform: NDArray[np.float64], colours: TextureCollector) -> _Part:
    textured = colours.add_mesh(mesh)
    points = trimesh.transform_points(textured.triangles.reshape(-1, 3), transform)
    return _Part(points.reshape(-1, 3, 3), textured.corner_uv, textured.face_texture)
