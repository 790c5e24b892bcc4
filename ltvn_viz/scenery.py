"""Scenes as the page draws them."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.sim.drawing_mesh import to_glb
from ltvn_core.sim.scenes import load_scene
from ltvn_viz.cutaway import cut_away
from ltvn_viz.unlit import shaded, without_lighting


@lru_cache(maxsize=4)
def scene_glb(name: str) -> bytes:
    """Return a scene as binary glTF, cut open and with its light painted in; raises SceneError for an unknown one."""
    return without_lighting(to_glb(shaded(cut_away(load_scene(name).surfaces))))


def floor_of(name: str) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return the low and the high corner (x_m, y_m) of a scene, None for an unknown one."""
    try:
        vertices, _ = load_scene(name).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
