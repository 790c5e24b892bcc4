"""What just changed: pruned edges rise and fade out magenta, new ones come in green."""

import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.analysis.map_history import FadingEdges
from ltvn_viz.layers import CHANGE_Z
from ltvn_viz.layers.graph_layers import offset_right
from ltvn_viz.layers.line_segments import LineSegments
from ltvn_viz.layers.pose_geometry import points
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.run_moment import FADE_S

RISE_M = 0.35


class ChangesLayer:
    """Two small batches that are animated, so that the big one need not be."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the two empty batches."""
        self.added = LineSegments(scene, "/graph/came", thickness_px=4.0)
        self.removed = LineSegments(scene, "/graph/went", thickness_px=5.0)
        self._blank = False

    def show(self, snapshot: Snapshot) -> None:
        """Draw the edges that came or went lately, by age."""
        added_edges, removed_edges = snapshot.moment.added_edges, snapshot.moment.removed_edges
        blank = not len(added_edges.ages_s) and not len(removed_edges.ages_s)
        if blank and self._blank:
            return
        self._blank = blank
        self._draw(self.added, added_edges, palette.EDGE_ADDED, rise_m=0.0)
        self._draw(self.removed, removed_edges, palette.EDGE_REMOVED, rise_m=RISE_M)

    @staticmethod
    def _draw(lines: LineSegments, fading: FadingEdges, colour: palette.Rgb8, *, rise_m: float) -> None:
        # Ages in tenths of a second: the page gets ten small updates a second, not thirty.
        ages = np.round(fading.ages_s, 1)
        segments = points(offset_right(fading.segments), CHANGE_Z)
        segments[..., 2] += (rise_m * ages / FADE_S)[:, None].astype(np.float32)
        lines.draw(segments, palette.faded(colour, ages, FADE_S))
