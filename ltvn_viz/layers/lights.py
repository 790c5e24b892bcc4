"""The light of a scene."""

import viser


def add_lights(scene: viser.SceneApi) -> None:
    """Light what has no light painted into it."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map("warehouse", environment_intensity=0.35)
