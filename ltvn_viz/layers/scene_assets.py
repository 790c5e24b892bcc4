"""Scenes as the page draws them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.gltf_export import to_glb
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.surfaces import Light, Surfaces, joined
from ltvn_core.worlds.world_change import OWN_PREFIX
from ltvn_core.worlds.world_state import AS_MADE, WorldState
from ltvn_viz.layers.cutaway import cut_away
from ltvn_viz.layers.unlit_materials import face_light, marked_unlit


def scene_glb(name: str, state: WorldState = AS_MADE) -> bytes:
    """Return a scene as binary glTF, cut open and with its light painted in; raises SceneError for an unknown one.

    Leaves of closed doors, things and people of that state are not in it.
    """
    own = tuple(each for each in state.things if each.thing.startswith(OWN_PREFIX))
    bare = replace(AS_MADE, things=own, missing=state.missing, pictures=state.pictures)
    return marked_unlit(_own_glb(name, bare), Light.of(state.light.level, state.light.warmth))


def added_glb(name: str, state: WorldState) -> bytes | None:
    """Return what stands in a scene for now as binary glTF: leaves, things and people; None where nothing does.

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
    scene = load_scene(name) if state == AS_MADE else _scenes(name).at(state)
    return _glb(cut_away(scene.surfaces))


@lru_cache(maxsize=2)
def _scenes(name: str) -> ChangedScenes:
    return ChangedScenes(load_scene(name))


def _glb(surfaces: Surfaces) -> bytes:
    return to_glb(surfaces, face_light(surfaces))


def floor_bounds(name: str) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return the low and the high corner (x_m, y_m) of a scene, None for an unknown one."""
    try:
        vertices, _ = load_scene(name).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
