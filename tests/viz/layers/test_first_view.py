"""Where the camera of the 3D scene stands first."""

from itertools import product
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ltvn_viz.layers.first_view import USUAL_ASPECT, Floor
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M

FOV = float(np.radians(75))


@pytest.mark.parametrize("high", [(6.0, 4.0), (-1.0, 30.0), (40.0, -0.5), (1.0, 0.0)])
def test_the_first_view_holds_the_whole_floor_with_its_walls_and_wastes_little(high: tuple[float, float]) -> None:
    low = (-2.0, -3.0)
    camera = SimpleNamespace(fov=FOV)
    Floor(low, high).begin(cast("Any", SimpleNamespace(initial_camera=camera)))
    position, look_at = np.array(camera.position), np.array(camera.look_at)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, (0, 0, 1)) / np.linalg.norm(np.cross(ahead, (0, 0, 1)))
    corners = np.array(list(product((low[0], high[0]), (low[1], high[1]), (0.0, CUT_HEIGHT_M)))) - position
    seen = np.column_stack([corners @ right / USUAL_ASPECT, corners @ np.cross(right, ahead)])
    seen /= (corners @ ahead * np.tan(FOV / 2))[:, None]

    assert np.abs(seen).max() < 1
    assert np.ptp(seen, axis=0).max() / 2 > 0.6
