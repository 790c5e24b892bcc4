"""The light of a scene and the view that it begins with."""

import numpy as np
import viser
from numpy.typing import ArrayLike


def add_lights(scene: viser.SceneApi) -> None:
    """Light what has no light painted into it."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map("warehouse", environment_intensity=0.35)


def set_initial_camera(server: viser.ViserServer, low: ArrayLike, high: ArrayLike) -> None:
    """Begin with a view over the floor between corners `low` and `high` (x_m, y_m), from above and at an angle."""
    middle = (np.asarray(low) + np.asarray(high)) / 2
    size = float(max(np.asarray(high) - np.asarray(low)))
    # Steep, so that walls hide little; and aimed a little low, so that the camera's window covers no room.
    server.initial_camera.look_at = (middle[0], middle[1] - 0.1 * size, 0.0)
    server.initial_camera.position = (middle[0], middle[1] - 0.32 * size, 0.86 * size)
