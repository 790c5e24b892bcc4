"""The floor plan of the building under the map: one image on the floor."""

import math

import viser

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_viz.layers.scene_assets import PICTURE_PX
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot

FLOOR_PLAN_NAME = "/floor-plan"
ABOVE_FLOOR_M = 0.005
"""Height of the image in metres: above the floor of the scene, and below everything of the map."""


class FloorPlanLayer:
    """The plan; the points that align it are chosen on the map from above."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Start without a drawing."""
        self._scene = scene
        self._shown: FloorPlanView | None = None
        self.image: viser.ImageHandle | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draw the plan at its current pose; nothing without a plan."""
        view = snapshot.floor_plan
        if view is None or view == self._shown:
            return
        self._shown = view
        if self.image is None:
            self.image = draw_floor_plan(self._scene, view.plan)
        self.image.position, self.image.wxyz = _pose(view.plan)


def draw_floor_plan(scene: viser.SceneApi, plan: FloorPlan) -> viser.ImageHandle:
    """Draw a floor plan at its pose."""
    width_m, height_m = plan.size_m
    position, turn = _pose(plan)
    return scene.add_image(
        FLOOR_PLAN_NAME,
        plan.picture(PICTURE_PX),
        width_m,
        height_m,
        format="png",
        cast_shadow=False,
        receive_shadow=False,
        wxyz=turn,
        position=position,
    )


def _pose(plan: FloorPlan) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return position and quaternion (wxyz) of a plan's image."""
    x, y, yaw = map(float, plan.middle)
    # Rotated about x, because viser's images face down, then by the yaw.
    return (x, y, ABOVE_FLOOR_M), (0.0, math.cos(yaw / 2), math.sin(yaw / 2), 0.0)
