"""The floor plan of the building under the map: one constant image on the floor."""

import math

import viser

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_viz.layers.scene_assets import PICTURE_PX

FLOOR_PLAN_NAME = "/floor-plan"
ABOVE_FLOOR_M = 0.005
"""Height of the image in metres: above the floor of the scene, and below everything of the map."""


def draw_floor_plan(scene: viser.SceneApi, plan: FloorPlan) -> viser.ImageHandle:
    """Draw a floor plan at its pose."""
    x, y, yaw = map(float, plan.middle)
    width_m, height_m = plan.size_m
    return scene.add_image(
        FLOOR_PLAN_NAME,
        plan.picture(PICTURE_PX),
        width_m,
        height_m,
        format="png",
        cast_shadow=False,
        receive_shadow=False,
        # Rotated about x, because viser's images face down, then by the yaw.
        wxyz=(0.0, math.cos(yaw / 2), math.sin(yaw / 2), 0.0),
        position=(x, y, ABOVE_FLOOR_M),
    )
