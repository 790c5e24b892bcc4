"""The panel of the viewer: pictures, verdict, numbers, and seven controls.

Owns the widgets and their wording. Every control only sends an order.
"""

from collections.abc import Callable, Sequence
from html import escape
from math import degrees

import numpy as np
import viser

from ltvn_core import palette
from ltvn_core.geometry import wrap_angle
from ltvn_core.training_data.failure_explanations import criterion_name, single_criteria
from ltvn_core.training_data.pair_table import LabelledPair, PairFilter
from ltvn_core.training_data.reachability_labels import FailedCriteria
from ltvn_viz.pairs.pair_browser import JumpToRandomPair, OpenScene, PairCommand, ShownPair, StepPairs
from ltvn_viz.pairs.pair_image import blank_pair_image, pair_image
from ltvn_viz.panels.html_widgets import STYLE, HtmlBlock, number_grid

FARTHEST_M = 4.0
"""End of the slider, where it stands for any distance."""

ALL, REACHABLE, UNREACHABLE = "all pairs", "reachable", "not reachable"
MOVES: dict[str, PairCommand] = {"Previous": StepPairs(-1), "Next": StepPairs(1), "Random": JumpToRandomPair()}

_STYLE = f"""<style>
.lp-key {{ display: flex; justify-content: space-between; color: #c1c2c5; }}
.lp-key b {{ color: #f1f3f5; font-weight: 600; }}
.lp-chip {{ display: inline-block; width: .8em; height: .8em; border-radius: 2px; margin-right: .4em;
  vertical-align: -1px; }}
.lp-verdict {{ display: flex; flex-wrap: wrap; gap: .3em .7em; align-items: center; color: #c1c2c5; }}
.lp-label {{ padding: .1em .8em; border-radius: 1em; font-weight: 600; color: #fff; background: #1864ab; }}
.lp-label[data-reachable="0"] {{ background: #9a4310; }}
.lp-why {{ margin: .35em 0 0; min-height: 1.45em; padding: 0; list-style: none; color: #dee2e6; }}
.lp-why b {{ color: {palette.TARGET.css}; font-weight: 600; }}
</style>"""


class PairPanel:
    """Shows a look and takes orders."""

    def __init__(self, gui: viser.GuiApi, scenes: Sequence[str], send: Callable[[PairCommand], None]) -> None:
        """Add the widgets to the main panel; `send` takes orders and returns at once."""
        gui.add_html(STYLE + _STYLE)
        HtmlBlock(gui, _key())
        self._image = gui.add_image(blank_pair_image(), format="jpeg", jpeg_quality=90)
        self._moves = gui.add_button_group("Pair", list(MOVES), hint="or press P, N, R")
        self._verdict, self._numbers = HtmlBlock(gui), HtmlBlock(gui)
        self._scene = gui.add_dropdown("Scene", list(scenes))
        self._kind = gui.add_dropdown("Show", list(_kinds()))
        self._range = gui.add_multi_slider(
            "Metres apart", 0.0, FARTHEST_M, 0.1, (0.0, FARTHEST_M), min_range=0.1, hint="the far end means any"
        )
        self._disagreeing = gui.add_checkbox("Network disagrees", False)
        self._bind(gui, send)

    def show(self, shown_pair: ShownPair) -> None:
        """Show a pair and what is said of it."""
        if shown_pair.pair is None:
            self._image.image = blank_pair_image()
            self._verdict.show(_card("No pair passes these filters."))
            self._numbers.show("")
            return
        self._image.image = pair_image(shown_pair.pair, shown_pair.waypoint)
        self._verdict.show(_verdict(shown_pair, shown_pair.pair))
        self._numbers.show(_numbers(shown_pair, shown_pair.pair))

    def show_busy(self, text: str) -> None:
        """Say what is being computed."""
        self._verdict.show(_card(text))

    def show_error(self, problem: str) -> None:
        """Say what went wrong."""
        self._verdict.show(_card(problem, severity="ERROR"))

    def pair_filter(self) -> PairFilter:
        """Return what the filters say."""
        low, high = self._range.value
        reachable, criterion = _kinds()[self._kind.value]
        farthest = float("inf") if high >= FARTHEST_M else high
        return PairFilter(reachable, criterion, low, farthest, self._disagreeing.value)

    def _bind(self, gui: viser.GuiApi, send: Callable[[PairCommand], None]) -> None:
        self._moves.on_click(lambda _: send(MOVES[self._moves.value]))
        self._scene.on_update(lambda _: send(OpenScene(self._scene.value)))
        for control in (self._kind, self._range, self._disagreeing):
            control.on_update(lambda _: send(self.pair_filter()))
        gui.add_command("Previous pair", hotkey="P").on_trigger(lambda _: send(MOVES["Previous"]))
        gui.add_command("Next pair", hotkey="N").on_trigger(lambda _: send(MOVES["Next"]))
        gui.add_command("Random pair", hotkey="R").on_trigger(lambda _: send(MOVES["Random"]))


def _kinds() -> dict[str, tuple[bool | None, FailedCriteria]]:
    """Return what each entry of the list of kinds asks for."""
    kinds: dict[str, tuple[bool | None, FailedCriteria]] = {
        ALL: (None, FailedCriteria.NOTHING),
        REACHABLE: (True, FailedCriteria.NOTHING),
        UNREACHABLE: (False, FailedCriteria.NOTHING),
    }
    return kinds | {f"fails: {criterion_name(each)}": (None, each) for each in single_criteria()}


def _key() -> str:
    def chip(colour: palette.Rgb8) -> str:
        return f'<span class="lp-chip" style="background:{colour.css}"></span>'

    return (
        f'<div class="lt"><div class="lp-key"><span>{chip(palette.SOURCE)}<b>Source</b></span>'
        f"<span>{chip(palette.TARGET)}<b>Target</b> and its true place</span>"
        f"<span>{chip(palette.PREDICTED_POSE)}place the network gives it</span></div></div>"
    )


def _card(text: str, severity: str = "INFO") -> str:
    return f'<div class="lt" role="status"><div class="lt-card" data-severity="{severity}">{escape(text)}</div></div>'


def _verdict(shown_pair: ShownPair, pair: LabelledPair) -> str:
    label = REACHABLE if pair.reachable else UNREACHABLE
    opinion = "agrees" if shown_pair.agrees else "disagrees"
    why = "".join(
        f'<li><b class="lp-criterion">{escape(reason.name)}</b> {escape(reason.text)}</li>'
        for reason in shown_pair.reasons
    )
    return (
        f'<div class="lt" role="status"><div class="lp-verdict">'
        f'<span class="lp-label" data-reachable="{int(pair.reachable)}">{label}</span>'
        f"<span>network <b>{opinion}</b></span>"
        f'<span class="lp-place">pair {shown_pair.number:,} of {shown_pair.count:,}, '
        f"images {pair.source} → {pair.target}</span>"
        f'</div><ul class="lp-why">{why}</ul></div>'
    )


def _numbers(shown_pair: ShownPair, pair: LabelledPair) -> str:
    off = np.hypot(*(shown_pair.waypoint - pair.waypoint)[:2])
    turn = abs(degrees(float(wrap_angle(shown_pair.waypoint[2] - pair.waypoint[2]))))
    return number_grid(
        (f"{pair.distance_m:.2f} m", "distance"),
        (f"{degrees(pair.waypoint[2]):+.0f}°", "yaw"),
        (_measured(pair.overlap, ".0%"), "overlap"),
        (_measured(pair.path_ratio, ".2f"), "path ratio"),
        (f"{shown_pair.reachability:.3f}", "network's r"),
        (f"{off:.2f} m", "place off by"),
        (f"{turn:.1f}°", "yaw off by"),
    )


def _measured(number: float, form: str) -> str:
    if np.isnan(number):
        return "–"
    return "∞" if np.isinf(number) else f"{number:{form}}"
