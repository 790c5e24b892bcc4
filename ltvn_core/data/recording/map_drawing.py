"""Draws robot and map for the Rerun viewer: converts frames and graphs to rows.

Owns shapes, and takes the colours with a meaning from `ltvn_core.palette`. Does not write rows itself. The rows of the
graph also have its exact columns, so that a clicked instance names its node or edge; nothing else is read back from
here. The viewer cannot look up the image of another step. Therefore the images of goal, subgoal and localised node are
kept in memory, and drawn again when the navigator names them. Events are drawn in `event_drawing`.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.frame_codec import MILLIMETRES_PER_METRE
from ltvn_core.data.recording.schema import ArchetypeColumns, RowTime, number_column
from ltvn_core.graph.deltas import Edge, FramesReserved, Node, NodeAdded
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as ev
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import FrameId, NodeId, Pose

GRAPH_HEIGHT_M = 0.05
"""Height in metres at which the graph is drawn, a little above the floor."""
_BLOCKED_HEIGHT_M = GRAPH_HEIGHT_M + 0.03
"""Height in metres at which blocked edges are drawn, above the others."""
_DEPTH_RANGE_MM = (0.0, 8000.0)
_TRAIL_COLOUR = [120, 120, 130]
_ODOMETRY_COLOUR = [150, 150, 150]
_NOSE_COLOUR = [255, 255, 255]
_RECENT_BYTES = 8 << 20
"""Number of bytes of the newest images that are kept in memory, because one of them may become a node."""


class DrawnEntity(NamedTuple):
    """One row for the viewer."""

    entity: str
    values: Sequence[rr.AsComponents]
    time: RowTime | None = None
    """Its place on the timelines; None for that of what is drawn."""


def static_entities(camera: CameraModel) -> list[DrawnEntity]:
    """Draw everything that does not change: axes, robot, camera, and the names of the curves."""
    radius_m = LOCOBOT.radius_m
    body = rr.Boxes3D(
        centers=[[0, 0, 0.2]], half_sizes=[[radius_m, radius_m, 0.2]], colors=[[90, 90, 100]], fill_mode="Solid"
    )
    return [
        DrawnEntity(schema.WORLD, [rr.ViewCoordinates.RIGHT_HAND_Z_UP]),
        DrawnEntity(schema.BODY, [body]),
        DrawnEntity(f"{schema.BODY}/nose", [_arrow(0.42, _NOSE_COLOUR)]),
        DrawnEntity(f"{schema.ODOMETRY}/arrow", [_arrow(GRAPH_HEIGHT_M, _ODOMETRY_COLOUR)]),
        DrawnEntity(schema.TRAIL, [rr.Points3D.from_fields(radii=0.015, colors=[_TRAIL_COLOUR])]),
        DrawnEntity(schema.CAMERA, [_pinhole(camera), rr.Transform3D(translation=[0, 0, camera.height_m])]),
        DrawnEntity(schema.RGB, [rr.EncodedImage.from_fields(media_type="image/jpeg")]),
        DrawnEntity(schema.DEPTH, [_depth_format()]),
        DrawnEntity(schema.GRAPH_SIZE, [rr.SeriesLines(names=["nodes", "edges"], interpolation_mode="StepAfter")]),
        DrawnEntity(schema.MARGIN, [rr.SeriesLines(names=["margin of the localisation"])]),
    ]


def draw_scene(glb: bytes) -> DrawnEntity:
    """Draw a binary glTF, z up."""
    return DrawnEntity(schema.SCENE, [rr.Asset3D(contents=glb, media_type="model/gltf-binary")])


def draw_robot(drawn_pose: Pose, odometry: Pose) -> list[DrawnEntity]:
    """Draw the robot at its drawn pose, a grey arrow at its odometry pose, and a point of its trail."""
    dot = rr.Points3D.from_fields(positions=[[float(drawn_pose[0]), float(drawn_pose[1]), GRAPH_HEIGHT_M / 2]])
    return [
        DrawnEntity(schema.ROBOT, [_transform(drawn_pose)]),
        DrawnEntity(schema.ODOMETRY, [_transform(odometry)]),
        DrawnEntity(schema.TRAIL, [dot]),
    ]


class MapDrawing:
    """Draws a map as it changes: positions of nodes and edges only when they change, beliefs every time."""

    def __init__(self) -> None:
        self._nodes: list[NodeId] = []
        self._edges: list[EdgeKey] = []
        self._blocked: list[EdgeKey] = []

    def draw(
        self, nodes: Sequence[Node], edges: Sequence[Edge], blocked: Sequence[EdgeKey], drawn_poses: DrawnPoses
    ) -> list[DrawnEntity]:
        """Draw the map, and on top once more the edges that were last seen blocked.

        `drawn_poses` must contain every node. The viewer shows the newest value of each column, so a column that is
        left out stays unchanged.
        """
        ids = [node.id for node in nodes]
        keys = [(edge.source, edge.target) for edge in edges]
        drawn = [
            DrawnEntity(schema.EDGES, _beliefs(edges) if keys == self._edges else _edges(keys, edges, drawn_poses)),
            DrawnEntity(schema.GRAPH_SIZE, [rr.Scalars([float(len(nodes)), float(len(edges))])]),
        ]
        if ids != self._nodes:
            drawn.append(DrawnEntity(schema.NODES, _nodes(ids, drawn_poses)))
        if list(blocked) != self._blocked:
            drawn.append(DrawnEntity(schema.BLOCKED, _blocked(blocked, drawn_poses)))
        self._nodes = ids
        self._edges = keys
        self._blocked = list(blocked)
        return drawn


def _nodes(ids: Sequence[NodeId], drawn_poses: DrawnPoses) -> list[rr.AsComponents]:
    points = rr.Points3D(drawn_poses.points(ids, GRAPH_HEIGHT_M), radii=0.07, colors=[palette.NODE])
    return [points, ArchetypeColumns(schema.NODE_ROW, {"node_id": number_column(ids, np.int32)})]


def _edges(keys: Sequence[EdgeKey], edges: Sequence[Edge], drawn_poses: DrawnPoses) -> list[rr.AsComponents]:
    colours, belief = _belief_columns(edges)
    strips = rr.LineStrips3D(_strips(keys, drawn_poses, GRAPH_HEIGHT_M), radii=0.02, colors=colours)
    return [strips, ArchetypeColumns(schema.EDGE_ROW, _ends(keys) | belief)]


def _beliefs(edges: Sequence[Edge]) -> list[rr.AsComponents]:
    colours, belief = _belief_columns(edges)
    return [rr.LineStrips3D.from_fields(colors=colours), ArchetypeColumns(schema.EDGE_ROW, belief)]


def _belief_columns(edges: Sequence[Edge]) -> tuple[NDArray[np.uint8], dict[str, pa.Array]]:
    """Return the colours (E, 3 or 4) of edges, and their beliefs by name."""
    beliefs = np.array([(e.belief.p, e.belief.mu, e.belief.sigma2) for e in edges], np.float32).reshape(-1, 3)
    columns = {name: number_column(beliefs[:, k], np.float32) for k, name in enumerate(("p", "mu", "sigma2"))}
    return palette.probability_colours(beliefs[:, 0]), columns


def _blocked(keys: Sequence[EdgeKey], drawn_poses: DrawnPoses) -> list[rr.AsComponents]:
    strips = _strips(keys, drawn_poses, _BLOCKED_HEIGHT_M)
    return [
        rr.LineStrips3D(strips, radii=0.04, colors=[palette.EDGE_REMOVED]),
        ArchetypeColumns(schema.EDGE_ROW, _ends(keys)),
    ]


def _strips(keys: Sequence[EdgeKey], drawn_poses: DrawnPoses, height_m: float) -> NDArray[np.float32]:
    """Return the start and end points (N, 2, 3) of drawn edges."""
    sources = [source for source, _ in keys]
    targets = [target for _, target in keys]
    return np.stack([drawn_poses.points(sources, height_m), drawn_poses.points(targets, height_m)], axis=1)


def _ends(keys: Sequence[EdgeKey]) -> dict[str, pa.Array]:
    return {
        "source": number_column([source for source, _ in keys], np.int32),
        "target": number_column([target for _, target in keys], np.int32),
    }


def _depth_format() -> rr.EncodedDepthImage:
    # Drawn as an image only, because depth points in 3D would hide the map.
    return rr.EncodedDepthImage.from_fields(
        media_type="image/png", meter=MILLIMETRES_PER_METRE, depth_range=_DEPTH_RANGE_MM
    )


def _arrow(height_m: float, colour: list[int]) -> rr.Arrows3D:
    return rr.Arrows3D(origins=[[0, 0, height_m]], vectors=[[0.35, 0, 0]], radii=0.02, colors=[colour])


def _transform(pose: Pose) -> rr.Transform3D:
    half_yaw = float(pose[2]) / 2
    # A new list, because Rerun reads an array only when it flushes.
    return rr.Transform3D(
        translation=[float(pose[0]), float(pose[1]), 0.0],
        quaternion=rr.Quaternion(xyzw=[0.0, 0.0, float(np.sin(half_yaw)), float(np.cos(half_yaw))]),
    )


def _pinhole(camera: CameraModel) -> rr.Pinhole:
    return rr.Pinhole(
        focal_length=[camera.fx, camera.fy],
        principal_point=[camera.cx + 0.5, camera.cy + 0.5],
        width=camera.width,
        height=camera.height,
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=0.4,
    )


class NodeImages:
    """Stores the JPEG of every image of the map, and draws the images that an event refers to."""

    def __init__(self) -> None:
        self._of_map: dict[FrameId, bytes] = {}
        self._recent: OrderedDict[FrameId, bytes] = OrderedDict()
        self._recent_bytes = 0
        self._drawn: dict[str, NodeId | None] = {}

    def add_frame(self, frame: FrameId, jpeg: bytes) -> None:
        """Store an image; if it is not of the map, it is dropped once there are some megabytes of newer images."""
        self._recent[frame] = jpeg
        self._recent_bytes += len(jpeg)
        while self._recent_bytes > _RECENT_BYTES:
            self._recent_bytes -= len(self._recent.popitem(last=False)[1])

    def keep(self, frames: Iterable[FrameId]) -> None:
        """Keep images of the map until the recording ends."""
        for frame in frames:
            if frame in self._recent:
                self._of_map[frame] = self._recent.pop(frame)
                self._recent_bytes -= len(self._of_map[frame])

    def draw(self, event: ev.Event) -> Iterator[DrawnEntity]:
        """Yield the images of the nodes that an event refers to, unless they are shown already."""
        match event:
            case ev.GraphChanged(delta=NodeAdded(node=node)):
                self.keep([node.id])
            case ev.GraphChanged(delta=FramesReserved(frames=frames)):
                self.keep(frames)
            case ev.QueryStarted(goal=goal):
                yield from self._image(schema.GOAL_IMAGE, goal)
            case ev.Localised(node=node) if node is not None:
                yield from self._image(schema.NODE_IMAGE, node)
            case ev.AttemptStarted(target=target):
                yield from self._image(schema.SUBGOAL_IMAGE, target)
            case _:
                pass

    def _image(self, entity: str, node: NodeId) -> Iterator[DrawnEntity]:
        if self._drawn.get(entity) != node and (jpeg := self._of_map.get(node)) is not None:
            self._drawn[entity] = node
            yield DrawnEntity(entity, [rr.EncodedImage(contents=jpeg, media_type="image/jpeg")])
