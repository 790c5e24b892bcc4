"""A floor plan that a person laid under the map: one picture on the floor, which never changes."""

import math

import viser

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_viz.layers.scene_assets import PICTURE_PX

FLOOR_PLAN_NAME = "/floor-plan"
ABOVE_FLOOR_M = 0.005
"""On a drawn scene's own floor, and below all that belongs to the map."""


def draw_floor_plan(scene: viser.SceneApi, plan: FloorPlan) -> viser.ImageHandle:
    """Draw a plan where it lies."""
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
        # Turned about x, because viser's images look down, then by the yaw.
        wxyz=(0.0, math.cos(yaw / 2), math.sin(yaw / 2), 0.0),
        position=(x, y, ABOVE_FLOOR_M),
    )
