"""What just changed: pruned edges rise and fade out red, new ones come in green."""

import numpy as np
import viser

from ltvn_viz import palette
from ltvn_viz.history import Fading
from ltvn_viz.layers import CHANGE_Z
from ltvn_viz.layers.graph import lanes
from ltvn_viz.layers.lines import Lines
from ltvn_viz.layers.placing import points
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.timeline import FADE_S

RISE_M = 0.35


class ChangesLayer:
    """Two small batches that are animated, so that the big one need not be."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the two empty batches."""
        self._came = Lines(scene, "/graph/came", thickness_px=4.0)
        self._went = Lines(scene, "/graph/went", thickness_px=5.0)
        self._blank = False

    def show(self, snapshot: Snapshot) -> None:
        """Draw the edges that came or went lately, by age."""
        came, went = snapshot.moment.came, snapshot.moment.went
        blank = not len(came.ages_s) and not len(went.ages_s)
        if blank and self._blank:
            return
        self._blank = blank
        self._draw(self._came, came, palette.CAME, rise_m=0.0)
        self._draw(self._went, went, palette.WENT, rise_m=RISE_M)

    @staticmethod
    def _draw(lines: Lines, fading: Fading, colour: palette.Rgb8, *, rise_m: float) -> None:
        # Ages in tenths of a second: the page gets ten small updates a second, not thirty.
        ages = np.round(fading.ages_s, 1)
        segments = points(lanes(fading.segments), CHANGE_Z)
        segments[..., 2] += (rise_m * ages / FADE_S)[:, None].astype(np.float32)
        lines.draw(segments, palette.faded(colour, ages, FADE_S))
