"""Layers of a query: the goal, the plan, and a ghost robot at the believed pose of the next subgoal."""

import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import NodeId
from ltvn_viz.layers import PLAN_Z
from ltvn_viz.layers.shapes import LineSegments, marker_mesh, points, wxyz
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
        line = points(moment.graph.poses_of(plan), PLAN_Z)
        segments = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.empty((0, 2, 3), np.float32)
        self.lines.draw(segments, np.full((len(segments), 3), palette.PLAN, np.uint8))


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


class GhostLayer:
    """A translucent robot base at the predicted pose of the subgoal."""

    def __init__(self, scene: viser.SceneApi, spec: RobotSpec) -> None:
        """Add a hidden ghost of the size in `spec`."""
        self.ghost = scene.add_frame("/ghost", show_axes=False, visible=False)
        scene.add_cylinder(
            "/ghost/base",
            radius=spec.clear_radius_m,
            height=0.12,
            color=palette.PREDICTED_POSE,
            opacity=0.45,
            position=(0.0, 0.0, 0.1),
            cast_shadow=False,
            receive_shadow=False,
        )
        vertices, faces = marker_mesh(0.3, 0.02)
        scene.add_mesh_simple(
            "/ghost/arrow",
            vertices,
            faces,
            color=palette.PREDICTED_POSE,
            position=(0.0, 0.0, 0.18),
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, snapshot: Snapshot) -> None:
        """Move the ghost to the predicted waypoint while an edge is driven."""
        pose = snapshot.moment.predicted_subgoal
        if pose is not None:
            self.ghost.position = points(pose, 0.0)
            self.ghost.wxyz = wxyz(pose[2])
        self.ghost.visible = pose is not None
