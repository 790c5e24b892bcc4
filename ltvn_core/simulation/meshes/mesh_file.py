"""Reads triangles and textures from a mesh file (GLB, glTF, OBJ, PLY).

Coordinates stay those of the file; `mesh_alignment` finds the upward axis and the unit.
"""

import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.meshes.asset_finder import AssetFinder
from ltvn_core.simulation.meshes.gltf_file import SUFFIXES as GLTF
from ltvn_core.simulation.meshes.gltf_file import GltfFile
from ltvn_core.simulation.meshes.mesh_textures import TextureCollector
from ltvn_core.simulation.surfaces import Surfaces

FORMATS = (".glb", ".gltf", ".obj", ".ply")
_NAMED = 5
"""Missing files that a message names at most."""


class MeshContent(NamedTuple):
    """What a mesh file holds."""

    surfaces: Surfaces
    """All triangles in the file's own axes and units."""
    doubts: tuple[str, ...]
    """What of its looks is missing, in whole sentences with what to do."""


def read_mesh(path: Path) -> MeshContent:
    """Return all triangles of a file, and what of its textures is missing.

    Raises:
        SceneError: The file does not exist, cannot be read or has no triangles.
    """
    if path.suffix.lower() not in FORMATS:
        raise SceneError(f"{path} is no scene: a mesh ends in {', '.join(FORMATS)}. Export it as one of these.")
    if not path.is_file():
        raise SceneError(f"The scene's file {path} does not exist. Put it there, or give the path where it is now.")
    colours = TextureCollector(linear_factors=path.suffix.lower() in GLTF)
    gltf = GltfFile.read(path) if path.suffix.lower() in GLTF else None
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
    return MeshContent(surfaces, tuple(_doubts(path, finder, gltf)))


def _doubts(path: Path, finder: AssetFinder, gltf: GltfFile | None) -> Iterator[str]:
    """Yield what of a mesh's looks is missing."""
    if finder.missing:
        names = ", ".join(finder.missing[:_NAMED]) + (" ..." if len(finder.missing) > _NAMED else "")
        yield (
            f"{path.name} names {names}, and there is no such file in {path.parent}, so what it colours is plain. Put "
            "the file there, under that name."
        )
    if gltf is not None:
        yield from gltf.texture_doubts()


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
            "it is complete, and no other format under this ending."
        ) from error
    return [(mesh, transform) for mesh, transform in placed if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]


class _Part:
    """One mesh in the coordinates of the file, without degenerate triangles."""

    def __init__(self, triangles: NDArray, corner_uv: NDArray, face_texture: NDArray) -> None:
        edges = triangles[:, 1:] - triangles[:, :1]
        with np.errstate(invalid="ignore", over="ignore"):
            doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        whole = np.isfinite(doubled) & (doubled > 0)
        self.triangles = triangles[whole]
        self.corner_uv = corner_uv[whole]
        self.face_texture = face_texture[whole]


def _part(mesh: trimesh.Trimesh, transform: NDArray[np.float64], colours: TextureCollector) -> _Part:
    textured = colours.add_mesh(mesh)
    points = trimesh.transform_points(textured.triangles.reshape(-1, 3), transform)
    return _Part(points.reshape(-1, 3, 3), textured.corner_uv, textured.face_texture)
