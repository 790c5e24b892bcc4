"""The floor plan of the building under the map: one image on the floor, and the clicks that align it."""

import math
from collections.abc import Callable

import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_viz.layers import PLAN_Z
from ltvn_viz.layers.scene_assets import PICTURE_PX
from ltvn_viz.layers.shapes import Markers, disc_mesh, wxyz
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot

FLOOR_PLAN_NAME = "/floor-plan"
ABOVE_FLOOR_M = 0.005
"""Height of the image in metres: above the floor of the scene, and below everything of the map."""
_SHEET_M = 0.04
"""Thickness in metres of the sheet that receives the clicks on the plan; the sheet covers the nodes."""
_MARK_M = 0.1


class FloorPlanLayer:
    """The plan and the clicked points; while a click on the plan is expected, also a coloured sheet that receives
    it."""

    def __init__(self, scene: viser.SceneApi, on_place: Callable[[tuple[float, float]], None]) -> None:
        """Start without a drawing; `on_place` gets a place (x, y) in metres, and must return at once."""
        self._scene = scene
        self._on_place = on_place
        self._shown: FloorPlanView | None = None
        self.image: viser.ImageHandle | None = None
        self.sheet: viser.BoxHandle | None = None
        self.marks = Markers(scene, f"{FLOOR_PLAN_NAME}-marks", disc_mesh(_MARK_M, corners=16), palette.ACCENT)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the plan at its current pose; nothing without a plan."""
        view = snapshot.floor_plan
        if view is None or view == self._shown:
            return
        self._shown = view
        if self.image is None:
            self.image = draw_floor_plan(self._scene, view.plan)
        self.image.position, self.image.wxyz = _pose(view.plan)
        self._show_sheet(view)
        self.marks.place(np.array([(*mark, 0.0) for mark in view.marks]).reshape(-1, 3), PLAN_Z)

    def _show_sheet(self, view: FloorPlanView) -> None:
        if self.sheet is not None:
            self.sheet.remove()
            self.sheet = None
        if view.node is not None:
            x, y, yaw = map(float, view.plan.middle)
            self.sheet = self._scene.add_box(
                f"{FLOOR_PLAN_NAME}-sheet",
                color=palette.ACCENT,
                dimensions=(*view.plan.size_m, _SHEET_M),
                position=(x, y, _SHEET_M / 2),
                wxyz=wxyz(yaw),
                opacity=0.25,
            )
            self.sheet.on_click(self._clicked)

    async def _clicked(self, event: viser.SceneNodePointerEvent) -> None:
        (x, y, z), (along_x, along_y, along_z) = event.ray_origin, event.ray_direction
        if along_z < 0:
            far = (ABOVE_FLOOR_M - z) / along_z
            self._on_place((x + far * along_x, y + far * along_y))


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
