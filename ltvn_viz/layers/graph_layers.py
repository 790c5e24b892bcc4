"""The map in the 3D scene.

Edges are lines whose colour and width both show their probability. All lines of a viser node have the same width, so
there are three nodes, each with a dark rim. If the p of an edge changes but its width does not, only the colours of a
node are sent again; if the width changes, the lines of two nodes are sent again.
"""

import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.types import NodeId
from ltvn_viz.layers import EDGE_Z, NODE_Z
from ltvn_viz.layers.shapes import Dots, LineSegments, drops, points
from ltvn_viz.session.snapshot import Snapshot

REDRAW_EVERY_S = 0.6
"""Least interval between two redraws of the edges in seconds; the page is slow to rebuild the lines of a big map."""
_DROP_ABOVE_M = 0.05
LANE_OFFSET_M = 0.025
"""Distance in metres by which an edge is shifted to its right, so that the two directions are separate lines."""


class NodesLayer:
    """All nodes as one batch of dots, with the heading of the selected node."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the empty batch."""
        self.markers = Dots(scene, "/graph/nodes")
        self.heading = drops(scene, "/graph/heading", 0.26, palette.GOAL)
        self._drawn: GraphArrays | None = None
        self._marked: tuple[NodeId | None, NodeId | None] = (None, None)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the nodes of the map; the goal and the robot's localised node have their own colours."""
        graph = snapshot.moment.graph
        progress = snapshot.moment.progress
        here = progress.localised.node if progress.localised is not None else None
        marked = (snapshot.selected, here)
        if graph is self._drawn and marked == self._marked:
            return
        if graph is not self._drawn:
            self.markers.place(graph.poses, NODE_Z)
        self.markers.paint(self._colours(graph, snapshot.selected, here))
        self.heading.place(graph.poses[graph.ids == snapshot.selected], NODE_Z + _DROP_ABOVE_M)
        self._drawn = graph
        self._marked = marked

    @staticmethod
    def _colours(graph: GraphArrays, goal: NodeId | None, here: NodeId | None) -> NDArray[np.uint8]:
        colours = np.full((len(graph.ids), 3), palette.NODE, np.uint8)
        colours[graph.exits] = palette.ACTION
        colours[graph.ids == here] = palette.LOCALISED
        colours[graph.ids == goal] = palette.GOAL
        return colours


EDGE_WIDTHS = (("unlikely", 0.0, 1.5), ("open", 1 / 3, 2.5), ("likely", 2 / 3, 3.5))
"""Classes of width, from thin to thick: name, least p of an edge, and thickness in pixels."""


class EdgeLines:
    """A batch of lines for each width."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        """Add the batches, empty and hidden."""
        self.batches = tuple(
            LineSegments(scene, f"{name}/{width}", thickness_px=thickness_px, outlined=True)
            for width, _, thickness_px in EDGE_WIDTHS
        )

    def draw(self, segments: NDArray[np.float32], p: NDArray[np.float64]) -> None:
        """Replace all edges, given their ends (N, 2, 3) and their probabilities (N,)."""
        colours = palette.probability_colours(p)
        widths = np.searchsorted([from_p for _, from_p, _ in EDGE_WIDTHS[1:]], p, side="right")
        for number, batch in enumerate(self.batches):
            chosen = widths == number
            batch.draw(segments[chosen], colours[chosen])


class EdgesLayer:
    """All edges: likely ones as thicker lines, and edges with an action as dashed lines."""

    def __init__(self, scene: viser.SceneApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the empty lines."""
        self.lines = EdgeLines(scene, "/graph/edges")
        self.actions = LineSegments(scene, "/graph/actions", thickness_px=3.5, outlined=True)
        self._clock = clock
        self._drawn: GraphArrays | None = None
        self._when = -np.inf

    def show(self, snapshot: Snapshot) -> None:
        """Draw the edges when the map changed, about twice a second at most."""
        graph = snapshot.moment.graph
        if graph is self._drawn or self._clock() - self._when < REDRAW_EVERY_S:
            return
        self._drawn = graph
        self._when = self._clock()
        segments = offset_right(graph.poses[:, :2][graph.edges])
        self.lines.draw(points(segments[~graph.acts], EDGE_Z), graph.p[~graph.acts])
        dashes = dashed(segments[graph.acts])
        self.actions.draw(points(dashes, EDGE_Z), np.tile(np.array(palette.ACTION, np.uint8), (len(dashes), 1)))


def offset_right(segments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shift segments (N, 2, 2) to the right, as seen in their direction."""
    along = segments[:, 1] - segments[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    right = np.stack([along[:, 1], -along[:, 0]], axis=1) / length
    return segments + LANE_OFFSET_M * right[:, None]


_DASHES = 4
"""Number of dashes of an edge."""


def dashed(segments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the dashes (N * 4, 2, 2) of segments (N, 2, 2)."""
    shares = np.linspace(0, 1, 2 * _DASHES).reshape(1, _DASHES, 2, 1)
    starts = segments[:, None, :1]
    return (starts + shares * (segments[:, None, 1:] - starts)).reshape(-1, 2, 2)
