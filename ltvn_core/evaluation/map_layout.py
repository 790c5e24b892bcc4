"""The layout of a recording's map for drawing.

Nodes are at their exact poses over the floor of the scene where both are known, else at their odometry without a floor.
`reports.map_svg` draws it.
"""

from dataclasses import dataclass

import numpy as np

from ltvn_core.errors import MapError, SceneError
from ltvn_core.evaluation.ground_truth import GroundTruth, floorplan
from ltvn_core.evaluation.results import MapDrawing
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.recording.reader import Recording
from ltvn_core.types import FrameId, Pose


@dataclass(frozen=True, eq=False)
class MapLayout:
    """A map with the positions of its nodes and the floor."""

    title: str
    graph: TopologicalGraph
    plan: MapDrawing
    """Without floor and without verdicts outside simulation."""
    simulated: bool
    """Whether the ground truth is known."""


def map_layout(recording: Recording, *, at_s: float | None = None) -> MapLayout:
    """Return the layout of the map at a time on the robot's clock, by default at the end.

    Raises MapError when there is no map at that time. Without the scene there is no floor.
    """
    graph = TopologicalGraph(
        stamped.event.delta
        for stamped in recording.events
        if isinstance(stamped.event, GraphChanged) and (at_s is None or stamped.stamp <= at_s)
    )
    if not graph.nodes:
        raise MapError(f"{recording.path} holds no map at that time; `ltvn info {recording.path}` says what it holds.")
    title = recording.path.name if at_s is None else f"{recording.path.name} at {at_s:.1f} s"
    truth = recorded_ground_truth(recording, graph)
    if truth is not None:
        return MapLayout(title=title, graph=graph, plan=floorplan(graph, truth), simulated=True)
    return MapLayout(title=title, graph=graph, plan=_by_odometry(graph), simulated=False)


def recorded_ground_truth(recording: Recording, graph: TopologicalGraph) -> GroundTruth | None:
    """Return the ground truth of a recording; None if its scene is missing or a node has no exact pose."""
    poses = exact_poses(recording)
    if poses is None or any(node not in poses for node in graph.nodes):
        return None
    try:
        from ltvn_core.simulation.scene_registry import load_scene

        clearance = load_scene(recording.meta.scene).clearance
    except (SceneError, ModuleNotFoundError):
        return None
    return GroundTruth(clearance, recording.observation, poses=poses)


def exact_poses(recording: Recording) -> dict[FrameId, Pose] | None:
    """Return the exact pose (3,) of each frame without decoding images; None outside simulation."""
    poses = recording.poses
    return None if poses.exact is None else dict(zip(recording.frames, poses.exact, strict=True))


def _by_odometry(graph: TopologicalGraph) -> MapDrawing:
    poses = ((node.id, node.odometry) for node in graph.nodes.values())
    nodes = tuple((name, pose.x_m, pose.y_m, pose.yaw_rad) for name, pose in poses)
    corner = np.array([row[1:3] for row in nodes]).min(axis=0)
    edges = tuple((*key, edge.belief.p, False) for key, edge in graph.edges.items())
    return MapDrawing(origin=(float(corner[0]), float(corner[1])), resolution_m=0.05, free=(), nodes=nodes, edges=edges)
