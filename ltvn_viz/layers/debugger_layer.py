"""Overlay of a debugger question on the map.

The selected edge has a white halo. It keeps the colour that the answer gives it, for instance that of edges that cannot
be driven; where the answer only points at it, it keeps the colour of its p, because orange would show a wrong p.
"""

from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_viz.layers import NODE_Z, PLAN_Z
from ltvn_viz.layers.shapes import LineSegments, drops, points
from ltvn_viz.session.inspection import EMPTY_OVERLAY, Label, Overlay, QuestionName, Stroke
from ltvn_viz.session.snapshot import Snapshot

_LABELS = 24
"""Maximum number of labels; more would be hard to read."""
_OVERLAY_Z = PLAN_Z + 0.03
_HALO_BELOW_M = 0.01
_SAME_PLACE_M = 1e-6


class DebuggerLayer:
    """The drawing of the question on show."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the parts, all empty."""
        self._scene = scene
        self.strokes = LineSegments(scene, "/debugger/strokes", thickness_px=7.0)
        self.halo = LineSegments(scene, "/debugger/halo", thickness_px=13.0)
        self._nodes = drops(scene, "/debugger/nodes", 0.2)
        self._ghosts = drops(scene, "/debugger/ghosts", 0.34)
        self._labels: list[viser.LabelHandle] = []
        self._drawn: Overlay = EMPTY_OVERLAY
        self._selected: tuple[EdgeKey, float] | None = None  # With its p.

    def show(self, snapshot: Snapshot) -> None:
        """Draw the overlay when it, the selected edge or the p of that edge changed."""
        inspection = snapshot.inspection
        overlay = inspection.answer.overlay
        selected = None if inspection.question is QuestionName.NONE else inspection.selection.edge
        graph = snapshot.moment.graph
        found = None if selected is None else _edge(graph, selected)
        believed = None if selected is None or found is None else (selected, found[1])
        if overlay is self._drawn and believed == self._selected:
            return
        self._drawn = overlay
        self._selected = believed
        self._draw_strokes(overlay.strokes, found)
        there = set(graph.ids.tolist()) if overlay.nodes else set()
        known = [node for node in overlay.nodes if node in there]
        self._nodes.place(graph.poses_of(tuple(known)), NODE_Z + 0.02)
        self._nodes.paint(np.array([overlay.nodes[node] for node in known], np.uint8).reshape(-1, 3))
        ghosts = np.array(overlay.ghosts, np.float64).reshape(-1, 3)
        self._ghosts.place(ghosts, _OVERLAY_Z)
        self._ghosts.paint(np.tile(np.array(palette.PREDICTED_POSE, np.uint8), (len(ghosts), 1)))
        self._write(overlay.labels)

    def _draw_strokes(self, strokes: Sequence[Stroke], selected: tuple[NDArray[np.float64], float] | None) -> None:
        """Draw the strokes, and around the selected edge, given as its ends (2, 2) and its p, a halo."""
        segments = np.array([(each.start, each.end) for each in strokes], np.float64).reshape(-1, 2, 2)
        colours = np.array([each.colour for each in strokes], np.uint8).reshape(-1, 3)
        is_selected = np.zeros(len(segments), bool)
        if selected is not None:
            ends, p = selected
            is_selected = np.all(np.abs(segments - ends) < _SAME_PLACE_M, axis=(1, 2))
            if not is_selected.any():
                segments = np.concatenate((segments, ends[None]))
                colours = np.concatenate((colours, np.array([palette.TARGET], np.uint8)))
                is_selected = np.append(is_selected, True)
            is_pointed_at = is_selected & np.all(colours == np.array(palette.TARGET), axis=1)
            colours[is_pointed_at] = palette.probability_colours([p])
        halo = segments[is_selected]
        self.halo.draw(points(halo, _OVERLAY_Z - _HALO_BELOW_M), np.full((len(halo), 3), 255, np.uint8))
        self.strokes.draw(points(segments, _OVERLAY_Z), colours)

    def _write(self, labels: tuple[Label, ...]) -> None:
        for handle in self._labels:
            handle.remove()
        self._labels = [
            self._scene.add_label(f"/debugger/label{number}", label.text, position=(*label.at, _OVERLAY_Z + 0.3))
            for number, label in enumerate(labels[:_LABELS])
        ]


def _edge(graph: GraphArrays, edge: EdgeKey) -> tuple[NDArray[np.float64], float] | None:
    """Return the ends (2, 2) of an edge of the map on show and its p; None if it is not in that map."""
    rows = np.flatnonzero(np.all(graph.ids[graph.edges] == np.array(edge), axis=1))
    if not len(rows):
        return None
    return graph.poses[:, :2][graph.edges[rows[0]]], float(graph.p[rows[0]])
