"""Scenes as the generation of data sees them. Owns nothing but the way from a name to one."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ltvn_core.training_data.scene_protocols import DatasetScene


def open_dataset_scene(name: str) -> "DatasetScene":
    """Open a simulated scene for data generation. Raises SceneError."""
    from ltvn_core.simulation.rendering.renderer_selection import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene
    from ltvn_core.training_data.scene_protocols import DatasetScene

    scene = load_scene(name)
    return DatasetScene(scene.name, scene.clearance, open_renderer(scene))
