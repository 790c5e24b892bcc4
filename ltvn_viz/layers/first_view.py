"""The initial view of the 3D scene: the whole floor."""

from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import ArrayLike

USUAL_ASPECT = 1.35
"""Ratio of width to height of a window; viser's page has one initial view for all."""
ROOM, WALLS_M = 1.25, 2.0
"""The view is wider than the floor by this factor, and by so many metres, because the walls near the camera rise."""
BACK = np.array([0.0, -0.35, 1.0]) / np.hypot(0.35, 1.0)
"""Unit vector from the floor to the camera; steep, so that walls hide little."""


@dataclass(frozen=True, slots=True)
class Floor:
    """Extent of the scene: the floor between two corners (2,), in metres."""

    low: ArrayLike
    high: ArrayLike

    def begin(self, server: viser.ViserServer) -> None:
        """Let new pages begin with a view of the whole floor."""
        low, high = np.asarray(self.low, float), np.asarray(self.high, float)
        width, depth = high - low
        away = (ROOM * max(width / USUAL_ASPECT, depth) + WALLS_M) / (2 * np.tan(server.initial_camera.fov / 2))
        middle = np.array([*(low + high) / 2, 0.0])
        server.initial_camera.position = tuple(middle + away * BACK)
        server.initial_camera.look_at = tuple(middle)
