"""Layers of a query: the goal and the plan."""

import viser

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.types import NodeId
from ltvn_viz.layers import PLAN_Z
from ltvn_viz.layers.shapes import LineSegments, points
from ltvn_viz.session.snapshot import Snapshot

PIN_HEIGHT_M = 1.3
"""Height of the goal's pin in metres; the pin must be visible above the furniture."""


class PlanLayer:
    """The path through the map that the robot follows."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the empty line."""
        self.lines = LineSegments(scene, "/plan", thickness_px=6.0)
        self._drawn: tuple[tuple[NodeId, ...], GraphArrays | None] = ((), None)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the plan when it changed."""
        moment = snapshot.moment
        plan = moment.progress.plan
        if plan == self._drawn[0] and (not plan or moment.graph is self._drawn[1]):
            return
        self._drawn = plan, moment.graph
        self.lines.draw_path(moment.graph.poses_of(plan), PLAN_Z, palette.PLAN)


class GoalLayer:
    """A pin at the goal."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the hidden pin."""
        self.pin = scene.add_frame("/goal", show_axes=False, visible=False)
        scene.add_cylinder(
            "/goal/stick",
            radius=0.02,
            height=PIN_HEIGHT_M,
            color=palette.GOAL,
            position=(0.0, 0.0, PIN_HEIGHT_M / 2),
            cast_shadow=False,
            receive_shadow=False,
        )
        scene.add_icosphere(
            "/goal/head",
            radius=0.13,
            color=palette.GOAL,
            position=(0.0, 0.0, PIN_HEIGHT_M),
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, snapshot: Snapshot) -> None:
        """Put the pin at the goal of the running query, or else at the chosen goal."""
        goal = snapshot.selected if snapshot.way is None else snapshot.way.goal
        poses = snapshot.moment.graph.poses_of(() if goal is None else (goal,))
        if len(poses):
            self.pin.position = points(poses[0], 0.0)
        self.pin.visible = bool(len(poses))
