"""The initial view of the 3D scene: the whole floor."""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M

MARGIN = 0.02
"""Least share of the scene's width and height that stays empty on each side."""
USUAL_ASPECT = 1.35
"""Ratio of width to height that is assumed for an unknown window, and for an exported map."""
BACK = np.array([0.0, -0.35, 1.0]) / np.hypot(0.35, 1.0)
"""Unit vector from the floor to the camera; steep, so that walls hide little."""
RIGHT = np.array([1.0, 0.0, 0.0])
UP = np.cross(BACK, RIGHT)

Corner = ArrayLike
"""Position (x, y) in metres, shape (2,)."""


class View(NamedTuple):
    """Position of a camera and the point that it looks at, each (3,), in metres."""

    position: NDArray[np.float64]
    look_at: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Floor:
    """Extent of the scene: the floor between two corners, with walls up to the height at which they are cut."""

    low: Corner
    high: Corner

    def view(self, aspect: float, fov: float) -> View:
        """Return the nearest view that shows the whole scene.

        Args:
            aspect: Ratio of width to height of the view.
            fov: Vertical angle of view of the camera, in radians.
        """
        (x0, y0), (x1, y1) = np.asarray(self.low, float), np.asarray(self.high, float)
        corners = np.array(list(product((x0, x1), (y0, y1), (0.0, CUT_HEIGHT_M))))
        slope = np.tan(fov / 2) * (1 - 2 * MARGIN)
        up, up_back = _between(corners, UP, slope)
        right, right_back = _between(corners, RIGHT, slope * aspect)
        position = right * RIGHT + up * UP + max(up_back, right_back) * BACK
        return View(position, position - BACK * position[2] / BACK[2])

    def begin(self, server: viser.ViserServer) -> None:
        """Set the initial view of new pages to one that suits most windows."""
        first = server.initial_camera
        view = self.view(USUAL_ASPECT, first.fov)
        first.position = tuple(view.position)
        first.look_at = tuple(view.look_at)


def _between(corners: NDArray[np.float64], across: NDArray[np.float64], slope: float) -> tuple[float, float]:
    """Return the camera's coordinate along `across`, and its least distance, for a view of all corners (N, 3).

    `slope` is the tangent of half the angle of view, reduced by the margin.
    """
    low, high = (float((side * corners @ across + slope * corners @ BACK).max()) for side in (-1, 1))
    return (high - low) / 2, (high + low) / 2 / slope
