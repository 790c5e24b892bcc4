"""A plan shows each thing where it stands."""

import numpy as np
import pytest

from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.top_view import top_view
from ltvn_core.simulation.scene_registry import Scene, load_scene
from ltvn_core.simulation.surface_builder import SurfaceBuilder

RED, GREEN, GREY = (220, 30, 30), (30, 200, 30), (128, 128, 128)


def test_x_grows_to_the_right_and_y_upwards_and_the_ceiling_is_off() -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(GREY)), (2.0, 1.0, -0.02), (4.0, 2.0, 0.04))
    builder.box(builder.texture(_plain(RED)), (3.5, 0.5, 0.5), (0.6, 0.6, 1.0))
    builder.box(builder.texture(_plain(GREEN)), (0.5, 1.5, 0.5), (0.6, 0.6, 1.0))
    builder.overhead = True
    builder.box(builder.texture(_plain((0, 0, 255))), (2.0, 1.0, 2.2), (4.0, 2.0, 0.04))
    clearance = ClearanceMap(np.zeros((40, 80), bool), np.zeros(2))
    plan = top_view(Scene("test room", 8.0, (), clearance, builder.build()), 20)
    assert plan.shape == (40, 80, 3)
    assert _colour_at(plan, 3.5, 0.5) == "red"
    assert _colour_at(plan, 0.5, 1.5) == "green"
    assert _colour_at(plan, 2.0, 1.0) == "grey"


def test_doorways_are_gaps_in_the_walls_of_a_plan() -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(GREEN)), (2.0, 1.0, -0.02), (4.0, 2.0, 0.04))
    paint = builder.texture(_plain(RED))
    builder.box(paint, (2.0, 0.5, 0.05), (0.2, 1.0, 0.1))
    builder.box(paint, (2.0, 0.5, 1.25), (0.2, 1.0, 2.5))
    builder.box(paint, (2.0, 1.5, 2.3), (0.2, 1.0, 0.4))
    blocked = np.zeros((40, 80), bool)
    blocked[:20, 38:42] = True
    plan = top_view(Scene("test room", 8.0, (), ClearanceMap(blocked, np.zeros(2)), builder.build()), 20)
    assert _colour_at(plan, 2.0, 0.5) == "red"
    assert _colour_at(plan, 2.0, 1.5) == "green"


def test_a_plan_of_an_apartment_has_one_pixel_per_cell_and_is_not_blank() -> None:
    scene = load_scene("train-00")
    plan = top_view(scene, 20)
    assert plan.shape[:2] == scene.clearance.blocked.shape
    assert plan.std() > 20


def test_a_plan_needs_a_size() -> None:
    with pytest.raises(ValueError, match="positive number of pixels"):
        top_view(load_scene("train-00"), 0)


def _plain(colour: tuple[int, int, int]) -> np.ndarray:
    return np.full((1, 1, 3), colour, np.uint8)


def _colour_at(plan: np.ndarray, x_m: float, y_m: float) -> str:
    red, green, blue = plan[int((2.0 - y_m) * 20), int(x_m * 20)].astype(int)
    if red > green + 60 and red > blue + 60:
        return "red"
    if green > red + 60 and green > blue + 60:
        return "green"
    return "blue" if blue > red + 60 else "grey"
