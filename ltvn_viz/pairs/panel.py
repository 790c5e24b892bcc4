"""The panel of the viewer: pictures, verdict, numbers, and seven controls.

Owns the widgets and their wording. Every control only sends an order.
"""

from collections.abc import Callable, Sequence
from html import escape
from math import degrees

import numpy as np
import viser

from ltvn_core.data.labels import Failed
from ltvn_core.data.pair_table import LabelledPair, Wanted
from ltvn_core.data.reasons import criteria, name_of
from ltvn_core.geometry import wrap_angle
from ltvn_viz import palette
from ltvn_viz.pairs.browser import Jump, Look, OpenScene, Order, Step
from ltvn_viz.pairs.pictures import nothing, picture_of
from ltvn_viz.panels.markup import STYLE, Markup, numbers

FARTHEST_M = 4.0
"""End of the slider, where it stands for any distance."""

ALL, REACHABLE, UNREACHABLE = "all pairs", "reachable", "not reachable"
MOVES: dict[str, Order] = {"Previous": Step(-1), "Next": Step(1), "Random": Jump()}

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

    def __init__(self, gui: viser.GuiApi, scenes: Sequence[str], send: Callable[[Order], None]) -> None:
        """Add the widgets to the main panel; `send` takes orders and returns at once."""
        gui.add_html(STYLE + _STYLE)
        Markup(gui, _key())
        self._picture = gui.add_image(nothing(), format="jpeg", jpeg_quality=90)
        self._moves = gui.add_button_group("Pair", list(MOVES), hint="or press P, N, R")
        self._verdict, self._numbers = Markup(gui), Markup(gui)
        self._scene = gui.add_dropdown("Scene", list(scenes))
        self._kind = gui.add_dropdown("Show", list(_kinds()))
        self._range = gui.add_multi_slider(
            "Metres apart", 0.0, FARTHEST_M, 0.1, (0.0, FARTHEST_M), min_range=0.1, hint="the far end means any"
        )
        self._disagreeing = gui.add_checkbox("Network disagrees", False)
        self._bind(gui, send)

    def show(self, look: Look) -> None:
        """Show a pair and what is said of it."""
        if look.pair is None:
            self._picture.image = nothing()
            self._verdict.show(_card("No pair passes these filters."))
            self._numbers.show("")
            return
        self._picture.image = picture_of(look.pair, look.waypoint)
        self._verdict.show(_verdict(look, look.pair))
        self._numbers.show(_numbers(look, look.pair))

    def wait(self, text: str) -> None:
        """Say what is being computed."""
        self._verdict.show(_card(text))

    def tell(self, problem: str) -> None:
        """Say what went wrong."""
        self._verdict.show(_card(problem, severity="ERROR"))

    def wanted(self) -> Wanted:
        """Return what the filters say."""
        low, high = self._range.value
        reachable, criterion = _kinds()[self._kind.value]
        farthest = float("inf") if high >= FARTHEST_M else high
        return Wanted(reachable, criterion, low, farthest, self._disagreeing.value)

    def _bind(self, gui: viser.GuiApi, send: Callable[[Order], None]) -> None:
        self._moves.on_click(lambda _: send(MOVES[self._moves.value]))
        self._scene.on_update(lambda _: send(OpenScene(self._scene.value)))
        for control in (self._kind, self._range, self._disagreeing):
            control.on_update(lambda _: send(self.wanted()))
        gui.add_command("Previous pair", hotkey="P").on_trigger(lambda _: send(MOVES["Previous"]))
        gui.add_command("Next pair", hotkey="N").on_trigger(lambda _: send(MOVES["Next"]))
        gui.add_command("Random pair", hotkey="R").on_trigger(lambda _: send(MOVES["Random"]))


def _kinds() -> dict[str, tuple[bool | None, Failed]]:
    """Return what each entry of the list of kinds asks for."""
    kinds: dict[str, tuple[bool | None, Failed]] = {
        ALL: (None, Failed.NOTHING),
        REACHABLE: (True, Failed.NOTHING),
        UNREACHABLE: (False, Failed.NOTHING),
    }
    return kinds | {f"fails: {name_of(each)}": (None, each) for each in criteria()}


def _key() -> str:
    def chip(colour: palette.Rgb8) -> str:
        return f'<span class="lp-chip" style="background:{colour.css}"></span>'

    return (
        f'<div class="lt"><div class="lp-key"><span>{chip(palette.SOURCE)}<b>Source</b></span>'
        f"<span>{chip(palette.TARGET)}<b>Target</b> and its true place</span>"
        f"<span>{chip(palette.GHOST)}place the network gives it</span></div></div>"
    )


def _card(text: str, severity: str = "INFO") -> str:
    return f'<div class="lt" role="status"><div class="lt-card" data-severity="{severity}">{escape(text)}</div></div>'


def _verdict(look: Look, pair: LabelledPair) -> str:
    label = REACHABLE if pair.reachable else UNREACHABLE
    opinion = "agrees" if look.agrees else "disagrees"
    why = "".join(
        f'<li><b class="lp-criterion">{escape(reason.name)}</b> {escape(reason.text)}</li>' for reason in look.reasons
    )
    return (
        f'<div class="lt" role="status"><div class="lp-verdict">'
        f'<span class="lp-label" data-reachable="{int(pair.reachable)}">{label}</span>'
        f"<span>network <b>{opinion}</b></span>"
        f'<span class="lp-place">pair {look.number:,} of {look.count:,}, images {pair.source} → {pair.target}</span>'
        f'</div><ul class="lp-why">{why}</ul></div>'
    )


def _numbers(look: Look, pair: LabelledPair) -> str:
    off = np.hypot(*(look.waypoint - pair.waypoint)[:2])
    turn = abs(degrees(float(wrap_angle(look.waypoint[2] - pair.waypoint[2]))))
    return numbers(
        (f"{pair.distance_m:.2f} m", "distance"),
        (f"{degrees(pair.waypoint[2]):+.0f}°", "yaw"),
        (_measured(pair.overlap, ".0%"), "overlap"),
        (_measured(pair.path_ratio, ".2f"), "path ratio"),
        (f"{look.reachability:.3f}", "network's r"),
        (f"{off:.2f} m", "place off by"),
        (f"{turn:.1f}°", "yaw off by"),
    )


def _measured(number: float, form: str) -> str:
    if np.isnan(number):
        return "–"
    return "∞" if np.isinf(number) else f"{number:{form}}"
