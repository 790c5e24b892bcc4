"""What a tool of the debugger draws over the map: strokes, coloured nodes, ghosts and labels."""

import numpy as np
import viser

from ltvn_core import palette
from ltvn_viz.layers import NODE_Z, PLAN_Z
from ltvn_viz.layers.line_segments import LineSegments
from ltvn_viz.layers.pose_geometry import points
from ltvn_viz.layers.pose_markers import PoseMarkers
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Label, Overlay
from ltvn_viz.session.snapshot import Snapshot

_LABELS = 24
"""More labels than this say nothing."""
_OVERLAY_Z = PLAN_Z + 0.03


class DebuggerLayer:
    """The drawing of the tool on show."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the empty parts."""
        self._scene = scene
        self._lines = LineSegments(scene, "/why/strokes", thickness_px=7.0)
        self._nodes = PoseMarkers(scene, "/why/nodes", 0.2)
        self._ghosts = PoseMarkers(scene, "/why/ghosts", 0.34)
        self._labels: list[viser.LabelHandle] = []
        self._drawn: Overlay = EMPTY_OVERLAY

    def show(self, snapshot: Snapshot) -> None:
        """Draw the overlay when it changed."""
        overlay = snapshot.inspection.answer.overlay
        if overlay is self._drawn:
            return
        self._drawn = overlay
        segments = np.array([(each.start, each.end) for each in overlay.strokes], np.float64).reshape(-1, 2, 2)
        colours = np.array([each.colour for each in overlay.strokes], np.uint8).reshape(-1, 3)
        self._lines.draw(points(segments, _OVERLAY_Z), colours)
        there = set(snapshot.moment.graph.ids.tolist()) if overlay.nodes else set()
        known = [node for node in overlay.nodes if node in there]
        marked = snapshot.moment.graph.poses_of(tuple(known))
        self._nodes.place(marked, NODE_Z + 0.02)
        self._nodes.paint(np.array([overlay.nodes[node] for node in known], np.uint8).reshape(-1, 3))
        ghosts = np.array(overlay.ghosts, np.float64).reshape(-1, 3)
        self._ghosts.place(ghosts, _OVERLAY_Z)
        self._ghosts.paint(np.tile(np.array(palette.PREDICTED_POSE, np.uint8), (len(ghosts), 1)))
        self._write(overlay.labels)

    def _write(self, labels: tuple[Label, ...]) -> None:
        for handle in self._labels:
            handle.remove()
        self._labels = [
            self._scene.add_label(f"/why/label{number}", label.text, position=(*label.at, _OVERLAY_Z + 0.3))
            for number, label in enumerate(labels[:_LABELS])
        ]
