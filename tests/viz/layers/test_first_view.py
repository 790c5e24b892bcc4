"""Where the camera of the 3D scene stands first: all of the floor is seen, as large as the scene allows."""

from itertools import product

import numpy as np
import pytest

from ltvn_viz.layers.first_view import MARGIN, Floor, View
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M, floor_bounds

FOV = np.radians(75)


def seen_at(view: View, point: np.ndarray, aspect: float) -> np.ndarray:
    """Return where a camera with z up sees a point (3,): (2,), each from -1 to 1 over the scene."""
    ahead = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
    right = np.cross(ahead, (0, 0, 1))
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    away = point - view.position
    return np.array([away @ right / aspect, away @ up]) / (away @ ahead) / np.tan(FOV / 2)


@pytest.mark.parametrize("aspect", [0.4, 0.96, 1.4, 2.5])
@pytest.mark.parametrize("high", [(6.0, 4.0), (-1.0, 30.0), (40.0, -0.5)])
def test_the_first_view_holds_the_whole_floor_and_wastes_nothing(aspect: float, high: tuple[float, float]) -> None:
    low = (-2.0, -3.0)
    view = Floor(low, high).view(aspect, float(FOV))
    corners = product((low[0], high[0]), (low[1], high[1]), (0.0, CUT_HEIGHT_M))
    seen = np.array([seen_at(view, np.array(corner), aspect) for corner in corners])
    edge = 1 - 2 * MARGIN
    assert np.abs(seen).max() == pytest.approx(edge)
    # What limits it, width or height, is filled from one side to the other.
    assert np.any(np.isclose(seen.max(axis=0), edge) & np.isclose(seen.min(axis=0), -edge))
    assert view.look_at[2] == pytest.approx(0)


@pytest.mark.parametrize("canvas", [(696, 726), (616, 242), (390, 280)])
def test_the_demo_flat_fills_most_of_the_canvas_of_usual_windows(canvas: tuple[int, int]) -> None:
    """What is left for the scene at 1400 x 900, 1000 x 640, and on a telephone of 390 x 844."""
    bounds = floor_bounds("demo")
    assert bounds is not None
    aspect = canvas[0] / canvas[1]
    view = Floor(*bounds).view(aspect, float(FOV))
    corners = product(*zip(*bounds, strict=True), (0.0, CUT_HEIGHT_M))
    seen = np.array([seen_at(view, np.array(corner), aspect) for corner in corners])
    filled = np.ptp(seen, axis=0) / 2
    assert filled[int(np.argmin(canvas))] >= 0.7
    assert filled.max() >= 0.95
