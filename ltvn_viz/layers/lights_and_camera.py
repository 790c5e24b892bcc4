"""The light of a scene and the view that it begins with."""

import numpy as np
import viser
from numpy.typing import ArrayLike

FITTING_ASPECT = 1.0
"""Width by height of a window in which the first view shows the whole floor."""
SAME_PLACE_M = 1e-3


def add_lights(scene: viser.SceneApi) -> None:
    """Light what has no light painted into it."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map("warehouse", environment_intensity=0.35)


def set_initial_camera(server: viser.ViserServer, low: ArrayLike, high: ArrayLike) -> None:
    """Begin with a view over the floor between corners `low` and `high` (x_m, y_m), from above and at an angle."""
    middle = (np.asarray(low) + np.asarray(high)) / 2
    size = float(max(np.asarray(high) - np.asarray(low)))
    # Steep, so that walls hide little.
    server.initial_camera.look_at = (middle[0], middle[1] - 0.02 * size, 0.0)
    server.initial_camera.position = (middle[0], middle[1] - 0.32 * size, 0.86 * size)


def fit_first_view(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Move the view of a page that has just come back until the floor fits, where its scene is high and narrow.

    A view that came with a link stays as it is.
    """
    first, camera = server.initial_camera, client.camera
    start = np.asarray(first.position)
    if camera.aspect >= FITTING_ASPECT or not np.allclose(camera.position, start, atol=SAME_PLACE_M):
        return
    target = np.asarray(first.look_at)
    camera.position = target + (start - target) * FITTING_ASPECT / camera.aspect
    camera.look_at = target
