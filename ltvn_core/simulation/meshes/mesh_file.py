"""Reads triangles and textures from a mesh file (GLB, glTF, OBJ, PLY).

Coordinates stay those of the file; `mesh_alignment` finds the upward axis and the unit.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.meshes.mesh_textures import TextureCollector
from ltvn_core.simulation.surfaces import Surfaces

FORMATS = (".glb", ".gltf", ".obj", ".ply")


def read_mesh(path: Path) -> Surfaces:
    """Return all triangles of a file in its own axes and units.

    Raises:
        SceneError: The file does not exist, cannot be read or has no triangles.
    """
    if path.suffix.lower() not in FORMATS:
        raise SceneError(f"{path} is no scene: a mesh ends in {', '.join(FORMATS)}. Export it as one of these.")
    if not path.is_file():
        raise SceneError(f"The scene's file {path} does not exist. Put it there, or give the path where it is now.")
    colours = TextureCollector(linear_factors=path.suffix.lower() in (".glb", ".gltf"))
    parts = [_part(mesh, transform, colours) for mesh, transform in _placed_meshes(path)]
    if sum(len(part.triangles) for part in parts) == 0:
        raise SceneError(
            f"{path} contains no triangles, only points or nothing. Export the surfaces of the scene as well."
        )
    triangles = np.concatenate([part.triangles for part in parts])
    return Surfaces(
        vertices=triangles.reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3),
        corner_uv=np.concatenate([part.corner_uv for part in parts]).astype(np.float32),
        face_texture=np.concatenate([part.face_texture for part in parts]).astype(np.int32),
        overhead=np.zeros(len(triangles), bool),
        textures=colours.textures(),
    )


def _placed_meshes(path: Path) -> list[tuple[trimesh.Trimesh, NDArray[np.float64]]]:
    """Return each mesh with its transform (4, 4).

    Catches every exception, because the parsers of these formats raise many types for damaged files.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene: Any = trimesh.load_scene(path, process=False)
            nodes = map(scene.graph.get, scene.graph.nodes_geometry)
            placed = [(scene.geometry[name], transform) for transform, name in nodes]
    except Exception as error:
        raise SceneError(
            f"{path} cannot be read as a {path.suffix[1:].upper()} mesh ({error or type(error).__name__}). Check that "
            "it is complete, not compressed (Draco) and not another format under this ending."
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
