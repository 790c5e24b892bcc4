"""Scenes as the page draws them."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.gltf_export import to_glb
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_viz.layers.cutaway import cut_away
from ltvn_viz.layers.unlit_materials import marked_unlit, with_baked_shading


@lru_cache(maxsize=4)
def scene_glb(name: str) -> bytes:
    """Return a scene as binary glTF, cut open and with its light painted in; raises SceneError for an unknown one."""
    return marked_unlit(to_glb(with_baked_shading(cut_away(load_scene(name).surfaces))))


def floor_bounds(name: str) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return the low and the high corner (x_m, y_m) of a scene, None for an unknown one."""
    try:
        vertices, _ = load_scene(name).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
