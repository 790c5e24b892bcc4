"""Finds scenes by name (generated, cached on disk, the same on every machine) or by the path of a mesh.

Other packages provide scenes in the entry-point group `ltvn.scenes`: `name = "package.module:function"`.

Holds the names, seeds and the cache. `apartments.generation` makes an apartment, the modules beside it make other
buildings, `meshes.mesh_scene` reads a mesh.
"""

import logging
import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.cache_folder import cache_folder
from ltvn_core.errors import SceneError
from ltvn_core.plugins import SCENES, Plugin, find_plugins
from ltvn_core.simulation.apartments.generation import Building, generate_apartment
from ltvn_core.simulation.apartments.hall import OPEN_ISLANDS, generate_hall
from ltvn_core.simulation.apartments.office import generate_office
from ltvn_core.simulation.apartments.plain_building import generate_plain_building
from ltvn_core.simulation.apartments.shop import generate_shop
from ltvn_core.simulation.apartments.wings import generate_wings
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.meshes.mesh_scene import load_mesh_scene
from ltvn_core.simulation.rooms import Room, RoomKind, SceneParts
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.terminal_text import which_name

log = logging.getLogger(__name__)

GENERATOR_VERSION = 2
"""Part of the cache's file names. Increase it if a seed gives another apartment than before."""
CACHE_VERSION = 2
"""Also part of the cache's file names. Increase it if other data of the same apartment are stored."""


@dataclass(frozen=True, slots=True)
class _Recipe:
    seed: int
    area_m2: float
    generate: Callable[[int, float], Building] = generate_apartment


_SEEDS_WITH_ALIASES = (6014, 6025, 6035, 6047)
"""Large apartments in which two or three kinds of room occur twice, so that they have perceptual aliases."""
_SEEDS_WITH_NARROW_PASSAGES = (6104, 6157)
"""Large apartments with many passages hardly wider than the robot."""
_SHOPS_M2 = (220.0, 300.0, 380.0, 560.0)
"""Floor areas of the shops in square metres; the last one has two halls."""
_HALLS_M2 = (340.0, 420.0, 500.0, 600.0)
"""Floor areas in square metres of the buildings that are mostly one hall, including the small rooms beside it."""
_WINGS_M2 = (620.0, 760.0, 1000.0, 1400.0)
"""Floor areas in square metres of the office buildings with repeated wings; the last two have two corridors."""


def _recipes() -> dict[str, _Recipe]:
    """Return the seed and area of every named scene.

    Each family has its own range of a thousand seeds, so that no training scene is also a test scene.
    """
    recipes = {"demo": _Recipe(7004, 66.0)}
    recipes |= {f"apartment-{area}": _Recipe(9000 + area, float(area)) for area in (57, 70, 124, 129)}
    recipes |= {f"train-{k:02d}": _Recipe(1000 + k, 45.0 + (k * 37) % 85) for k in range(40)}
    recipes |= {f"tune-{k}": _Recipe(5000 + k, 55.0 + 13 * (k % 6) + 5 * (k // 6)) for k in range(9)}
    recipes |= {f"tune-twin-{k}": _Recipe(seed, 128.0) for k, seed in enumerate(_SEEDS_WITH_ALIASES)}
    recipes |= {f"tune-narrow-{k}": _Recipe(seed, 126.0) for k, seed in enumerate(_SEEDS_WITH_NARROW_PASSAGES)}
    recipes |= {f"office-{k}": _Recipe(8000 + k, 500.0, generate_office) for k in range(4)}
    recipes |= {f"tune-office-{k}": _Recipe(8500 + k, 500.0, generate_office) for k in range(4)}
    recipes |= {f"plain-{k}": _Recipe(8200 + k, 200.0, generate_plain_building) for k in range(4)}
    recipes |= {f"tune-plain-{k}": _Recipe(8700 + k, 200.0, generate_plain_building) for k in range(4)}
    recipes |= {f"shop-{k}": _Recipe(11000 + k, area, generate_shop) for k, area in enumerate(_SHOPS_M2)}
    recipes |= {f"tune-shop-{k}": _Recipe(11500 + k, area, generate_shop) for k, area in enumerate(_SHOPS_M2)}
    recipes |= {f"hall-{k}": _Recipe(12000 + k, area, generate_hall) for k, area in enumerate(_HALLS_M2)}
    recipes |= {f"tune-hall-{k}": _Recipe(12500 + k, area, generate_hall) for k, area in enumerate(_HALLS_M2)}
    open_hall = partial(generate_hall, islands=OPEN_ISLANDS)
    recipes |= {f"tune-tables-{k}": _Recipe(14500 + k, 320.0, open_hall) for k in range(2)}
    recipes |= {f"wings-{k}": _Recipe(13000 + k, area, generate_wings) for k, area in enumerate(_WINGS_M2)}
    recipes |= {f"tune-wings-{k}": _Recipe(13500 + k, area, generate_wings) for k, area in enumerate(_WINGS_M2)}
    return recipes


_RECIPES = _recipes()


def scene_names() -> tuple[str, ...]:
    """Return all names that `load_scene` accepts: ours, then those of other packages."""
    return (*_RECIPES, *(name for name in find_plugins(SCENES) if name not in _RECIPES))


@lru_cache(maxsize=4)
def load_scene(name: str) -> Scene:
    """Return a scene by its name or path.

    Args:
        name: One of `scene_names()`, or the path of a mesh file (GLB, glTF, OBJ, PLY) or of a folder in Gibson layout.
            Our own scenes are generated at the first call and then read from the user's cache. Other packages create
            their own scenes.

    Raises:
        SceneError: There is no such scene, or its mesh cannot be used.
        PluginError: Another package's scene is broken.
    """
    if name not in _RECIPES:
        plugin = find_plugins(SCENES).get(name)
        return load_mesh_scene(_mesh_path(name)) if plugin is None else _foreign_scene(plugin)
    path = _cache_path(name)
    if (cached := _read_cache(name, path)) is not None:
        return cached
    scene = _generate(name)
    _write_cache(scene, path)
    return scene


def check_scene(name: str) -> None:
    """Raise SceneError unless there is a scene of that name or path; loads nothing."""
    if name not in scene_names():
        _mesh_path(name)


def load_scene_factory(plugin: Plugin) -> Callable[[], object]:
    """Import the function of a scene. Raises PluginError if it is none, or if its name is one of our own scenes."""
    make = plugin.load()
    if not callable(make):
        raise plugin.refusal("is not a function that returns a Scene or the path of a mesh")
    if plugin.name in _RECIPES:
        raise plugin.refusal("has the name of a scene of the toolkit, which is used instead")
    return make


def _foreign_scene(plugin: Plugin) -> Scene:
    """Return the scene of another package, whose function without arguments returns a Scene or the path of a mesh."""
    make = load_scene_factory(plugin)
    with plugin.running("cannot be made"):
        made = make()
        scene = load_mesh_scene(Path(made)) if isinstance(made, str | Path) else made
    if not isinstance(scene, Scene):
        raise plugin.refusal(f"returns {type(scene).__name__}, not a Scene or the path of a mesh")
    return replace(scene, name=plugin.name, source=None)  # So that recordings find it by its name.


def _mesh_path(name: str) -> Path:
    """Return the absolute path of a mesh, or its path in the current folder if it was moved there."""
    path = Path(os.path.expanduser(name)).absolute()
    if path.exists():
        return path
    if not path.suffix and len(Path(name).parts) == 1:
        raise SceneError(
            f"There is no scene {name!r}. {which_name(name, scene_names())}; or give the path of a mesh "
            "(.glb, .gltf, .obj, .ply) or of a folder in Gibson layout."
        )
    here = Path(path.name).absolute()
    if not here.exists():
        raise SceneError(
            f"The scene's file {path} does not exist. Put it there or into the current folder ({Path.cwd()}), or give "
            "its new path."
        )
    log.warning("The scene's file %s does not exist; using %s.", path, here)
    return here


def _cache_path(name: str) -> Path:
    """Return a file name with all parameters of a scene, so that a changed recipe never reads an old file."""
    recipe = _RECIPES[name]
    file = f"{name}-seed{recipe.seed}-{recipe.area_m2:g}m2-v{GENERATOR_VERSION}.{CACHE_VERSION}.npz"
    return cache_folder() / "scenes" / file


def _generate(name: str) -> Scene:
    recipe = _RECIPES[name]
    grown = recipe.generate(recipe.seed, recipe.area_m2)
    plan = grown.plan
    area_m2 = round(plan.width * plan.depth, 2)
    return Scene(
        name=name,
        area_m2=area_m2,
        rooms=plan.rooms,
        clearance=ClearanceMap(grown.blocked, grown.origin),
        surfaces=grown.surfaces,
        parts=grown.parts,
    )


def _write_cache(scene: Scene, path: Path) -> None:
    """Write a scene to the cache atomically; if the cache cannot be written, loading only takes longer."""
    surfaces = scene.surfaces
    # Room kinds are stored as indices, so members of RoomKind may not be reordered.
    room_kinds = np.array([[*RoomKind].index(room.kind) for room in scene.rooms])
    room_edges = np.array([[room.x0, room.y0, room.x1, room.y1] for room in scene.rooms])
    arrays: dict[str, Any] = {f"texture{k:04d}": texture for k, texture in enumerate(surfaces.textures)}
    arrays |= {
        "area": scene.area_m2,
        "room_kinds": room_kinds,
        "room_edges": room_edges,
        "blocked": scene.clearance.blocked,
        "origin": scene.clearance.origin,
        "vertices": surfaces.vertices,
        "faces": surfaces.faces,
        "corner_uv": surfaces.corner_uv,
        "face_texture": surfaces.face_texture,
        "overhead": surfaces.overhead,
    }
    arrays |= scene.parts.arrays()
    try:
        _write_whole(path, arrays)
    except OSError as error:
        log.warning("The scene %s could not be cached at %s: %s", scene.name, path, error)


def _write_whole(path: Path, arrays: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as part:
        try:
            np.savez(part, **arrays)
        except OSError:
            os.unlink(part.name)
            raise
    os.replace(part.name, path)


def _read_cache(name: str, path: Path) -> Scene | None:
    """Read a scene from the cache; None if the file does not exist or is damaged."""
    try:
        # Opened here, because np.load does not close a file that is no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as cached:
            textures = tuple(cached[key] for key in sorted(cached.files) if key.startswith("texture"))
            kinds = [*RoomKind]
            rows = zip(cached["room_kinds"].tolist(), cached["room_edges"].tolist(), strict=True)
            return Scene(
                name=name,
                area_m2=float(cached["area"]),
                rooms=tuple(Room(kind=kinds[kind], x0=x0, y0=y0, x1=x1, y1=y1) for kind, (x0, y0, x1, y1) in rows),
                clearance=ClearanceMap(cached["blocked"], cached["origin"]),
                surfaces=Surfaces(
                    vertices=cached["vertices"],
                    faces=cached["faces"],
                    corner_uv=cached["corner_uv"],
                    face_texture=cached["face_texture"],
                    overhead=cached["overhead"],
                    textures=textures,
                ),
                parts=SceneParts.from_arrays(cached),
            )
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        log.warning("The cached scene %s is damaged and will be made again: %s", path, error)
        return None
