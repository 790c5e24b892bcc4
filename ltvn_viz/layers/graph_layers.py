"""The map: nodes as drops that point where they look, edges coloured by the belief that they can be driven."""

import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.layers import EDGE_Z, NODE_Z
from ltvn_viz.layers.line_segments import LineSegments
from ltvn_viz.layers.pose_geometry import points
from ltvn_viz.layers.pose_markers import PoseMarkers
from ltvn_viz.session.snapshot import Snapshot

REDRAW_EVERY_S = 0.6
"""The page rebuilds all lines of a node when any changes, which is slow for a big map."""
BLOCKED_Z = EDGE_Z + 0.03
LANE_OFFSET_M = 0.025
"""An edge keeps to the right by this much, so that there and back are two lines."""


class NodesLayer:
    """All nodes as one batch; clicking one names it."""

    def __init__(self, scene: viser.SceneApi, on_pick: Callable[[NodeId, int], None]) -> None:
        """Add the empty batch; `on_pick` gets the node and viser's number of the page, and must return at once."""
        self.markers = PoseMarkers(scene, "/graph/nodes", 0.14, outlined=True)
        self._drawn: GraphArrays | None = None
        self._marked: tuple[NodeId | None, NodeId | None] = (None, None)

        @self.markers.on_click
        async def _(event: viser.SceneNodePointerEvent) -> None:
            graph = self._drawn
            if graph is not None and event.instance_index is not None and event.instance_index < len(graph.ids):
                on_pick(int(graph.ids[event.instance_index]), event.client_id)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the nodes of the map; the goal and the node where the robot thinks it is stand out."""
        graph, progress = snapshot.moment.graph, snapshot.moment.progress
        here = progress.localised.node if progress.localised is not None else None
        marked = (snapshot.selected, here)
        if graph is self._drawn and marked == self._marked:
            return
        if graph is not self._drawn:
            self.markers.place(graph.poses, NODE_Z)
        self.markers.paint(self._colours(graph, snapshot.selected, here))
        self._drawn, self._marked = graph, marked

    @staticmethod
    def _colours(graph: GraphArrays, goal: NodeId | None, here: NodeId | None) -> NDArray[np.uint8]:
        colours = np.full((len(graph.ids), 3), palette.NODE, np.uint8)
        colours[graph.ids == here] = palette.LOCALISED
        colours[graph.ids == goal] = palette.GOAL
        return colours


class EdgesLayer:
    """All edges as one batch of lines."""

    def __init__(self, scene: viser.SceneApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the empty batch."""
        self.lines = LineSegments(scene, "/graph/edges", thickness_px=2.0, outlined=True)
        self._clock = clock
        self._drawn: GraphArrays | None = None
        self._when = -np.inf

    def show(self, snapshot: Snapshot) -> None:
        """Draw the edges when the map changed, about twice a second at most."""
        graph = snapshot.moment.graph
        if graph is self._drawn or self._clock() - self._when < REDRAW_EVERY_S:
            return
        self._drawn, self._when = graph, self._clock()
        segments = offset_right(graph.poses[:, :2][graph.edges])
        self.lines.draw(points(segments, EDGE_Z), palette.probability_colours(graph.p))


class BlockedEdgesLayer:
    """Edges that were seen blocked when they were seen last, drawn over the others."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the empty batch."""
        self.lines = LineSegments(scene, "/graph/blocked", thickness_px=4.0, outlined=True)
        self._drawn: frozenset[EdgeKey] = frozenset()

    def show(self, snapshot: Snapshot) -> None:
        """Draw them anew when there are others."""
        blocked, graph = snapshot.moment.progress.blocked, snapshot.moment.graph
        if blocked == self._drawn:
            return
        self._drawn = blocked
        places = {int(node): pose[:2] for node, pose in zip(graph.ids, graph.poses, strict=True)}
        ends = [(places[a], places[b]) for a, b in sorted(blocked) if a in places and b in places]
        segments = offset_right(np.array(ends, np.float64).reshape(-1, 2, 2))
        self.lines.draw(points(segments, BLOCKED_Z), np.tile(np.array(palette.EDGE_REMOVED, np.uint8), (len(ends), 1)))


def offset_right(segments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shift segments (N, 2, 2) to the right of their direction."""
    along = segments[:, 1] - segments[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    right = np.stack([along[:, 1], -along[:, 0]], axis=1) / length
    return segments + LANE_OFFSET_M * right[:, None]
