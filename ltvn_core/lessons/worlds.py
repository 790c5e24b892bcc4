"""Scenes as the generation of data sees them. Owns nothing but the way from a name to one."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ltvn_core.data.worlds import World


def open_world(name: str) -> "World":
    """Open a simulated scene for data generation. Raises SceneError."""
    from ltvn_core.data.worlds import World
    from ltvn_core.sim.camera import open_camera
    from ltvn_core.sim.scenes import load_scene

    scene = load_scene(name)
    return World(scene.name, scene.clearance, open_camera(scene))
