"""Edges of a map as lines whose colour and width both show their probability.

Owns the widths. All lines of a viser node have the same width, so there are three nodes, each with a dark rim. If the p
of an edge changes but its width does not, only the colours of a node are sent again; if the width changes, the lines of
two nodes are sent again.
"""

from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_viz.layers.shapes import LineSegments


class EdgeWidth(NamedTuple):
    """Lines of one width."""

    name: str
    from_p: float
    """Least p of an edge with this width."""
    thickness_px: float


EDGE_WIDTHS = (
    EdgeWidth("unlikely", 0.0, 1.5),
    EdgeWidth("open", 1 / 3, 2.5),
    EdgeWidth("likely", 2 / 3, 3.5),
)
"""Classes of width, from thin to thick."""


class EdgeLines:
    """A batch of lines for each width."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        """Add the batches, empty and hidden."""
        self.batches = tuple(
            LineSegments(scene, f"{name}/{width.name}", thickness_px=width.thickness_px, outlined=True)
            for width in EDGE_WIDTHS
        )

    def draw(self, segments: NDArray[np.float32], p: NDArray[np.float64]) -> None:
        """Replace all edges, given their ends (N, 2, 3) and their probabilities (N,)."""
        colours = palette.probability_colours(p)
        widths = np.searchsorted([width.from_p for width in EDGE_WIDTHS[1:]], p, side="right")
        for number, batch in enumerate(self.batches):
            chosen = widths == number
            batch.draw(segments[chosen], colours[chosen])
