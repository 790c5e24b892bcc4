"""The legend below the scene: the meaning of each colour.

Owns the choice of colours. Colours that the scene does not show now are pale but stay in place, so that the layout does
not change.
"""

from collections.abc import Iterator
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.palette import Rgb8
from ltvn_viz.panels.html_widgets import HtmlBlock
from ltvn_viz.session.snapshot import Snapshot


class LegendPanel:
    """One line of colours, for one page."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the legend; if there is room, the page's script copies it below the scene."""
        self.legend = HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Show the present meaning of the scene's colours."""
        ramps = [_ramp("edge p", "0", "1", palette.PROBABILITY_RAMP, _AS_WIDE_AS_EDGES)]
        if snapshot.inspection.answer.overlay.is_of_likeness:
            ramps.append(_ramp("node looks", "unlike", "alike", palette.SCORE_RAMP))
        chips = "".join(_chip(*each) for each in _colours(snapshot))
        self.legend.show(
            '<div class="ltvn-only-narrow" style="padding:.2em .75em"><div data-ltvn-copy="legend">'
            f'<div class="lt-legend">{"".join(ramps)}{chips}</div></div></div>'
        )


def _colours(snapshot: Snapshot) -> Iterator[tuple[Rgb8, str, bool]]:
    """Yield each colour with its meaning, and whether the scene shows it now."""
    moment = snapshot.moment
    progress = moment.progress
    is_going = bool(len(moment.removed_edges.ages_s)) or bool(progress.blocked)
    yield palette.ROBOT, "robot", moment.robot is not None
    yield palette.NODE, "node", bool(len(moment.graph.ids))
    yield palette.ACTION, "needs an action", bool(moment.graph.exits.any())
    yield palette.PLAN, "plan, and where the robot thinks it is", bool(progress.plan) or progress.localised is not None
    yield palette.GOAL, "goal", snapshot.selected is not None
    yield palette.TRAJECTORY, "driven", len(moment.trajectory) > 1
    yield palette.EDGE_ADDED, "new edge", bool(len(moment.added_edges.ages_s))
    yield palette.EDGE_REMOVED, "pruned or blocked edge", is_going


def _chip(colour: Rgb8, name: str, is_shown: bool) -> str:
    return f'<span data-shown="{int(is_shown)}"><i style="background:{colour.css}"></i>{escape(name)}</span>'


_AS_WIDE_AS_EDGES = "clip-path:polygon(0 30%,100% 0,100% 100%,0 70%);"
"""Style that gives the ramp the shape of a wedge, because likely edges are drawn thicker."""


def _ramp(name: str, least: str, most: str, ramp: NDArray[np.float64], shape: str = "") -> str:
    return (
        f'<span class="lt-ramp" data-shown="1">{escape(name)}&nbsp;{escape(least)}'
        f'<i style="{shape}background:linear-gradient(90deg,{palette.gradient_css(ramp)})"></i>{escape(most)}</span>'
    )
