"""The panel of the pair viewer: images, verdict, numbers, and controls.

Owns the widgets and their texts, and the image of a pair: colour above, depth below, and the waypoints drawn into the
source image. The controls only send commands. `network.training_data.pair_table` computes where a waypoint appears in
an image.
"""

from collections.abc import Callable, Sequence
from html import escape
from itertools import pairwise
from math import degrees

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.pair_table import (
    LabelledPair,
    PairFilter,
    WaypointOutline,
    criterion_name,
    single_criteria,
    waypoint_outline,
)
from ltvn_core.network.training_data.reachability_labels import FailedCriteria
from ltvn_core.palette import Rgb8
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Rgb, Waypoint
from ltvn_viz.pairs.pair_browser import JumpToRandomPair, OpenScene, PairCommand, ShownPair, StepPairs
from ltvn_viz.panels.camera_panel import depth_colours
from ltvn_viz.panels.html_widgets import STYLE, HtmlBlock, number_grid

SCALE = 5
"""Pixels on the screen per pixel of the camera."""
GAP = 12
BORDER = 4

_DARK = Rgb8(15, 17, 22)
_OUT_OF_SIGHT_PX = 1e4


def pair_image(pair: LabelledPair, predicted: Waypoint) -> Rgb:
    """Return source and target side by side with the true and the predicted place of the target."""
    source = _enlarged(pair.source_rgb)
    _draw(source, waypoint_outline(pair.waypoint), palette.TARGET)
    _draw(source, waypoint_outline(predicted), palette.PREDICTED_POSE)
    rows = [
        (source, _enlarged(pair.target_rgb)),
        (_depth(pair.source_depth), _depth(pair.target_depth)),
    ]
    edges = (palette.SOURCE, palette.TARGET)
    return _stacked([_stacked([_framed(*each) for each in zip(row, edges, strict=True)], axis=1) for row in rows], 0)


def blank_pair_image() -> Rgb:
    """Return an empty image of the size of `pair_image`."""
    size = LOCOBOT.camera
    return np.full((2 * size.height * SCALE + GAP, 2 * size.width * SCALE + GAP, 3), palette.BACKGROUND, np.uint8)


def _enlarged(rgb: Rgb) -> Rgb:
    height, width = rgb.shape[:2]
    return np.ascontiguousarray(
        cv2.resize(rgb, (width * SCALE, height * SCALE), interpolation=cv2.INTER_CUBIC), np.uint8
    )


def _depth(depth: NDArray[np.floating]) -> Rgb:
    height, width = depth.shape
    large = cv2.resize(depth, (width * SCALE, height * SCALE), interpolation=cv2.INTER_NEAREST)
    return depth_colours(np.asarray(large, np.float32))


def _framed(image: Rgb, colour: Rgb8) -> Rgb:
    image = image.copy()
    for side in (np.s_[:BORDER], np.s_[-BORDER:], np.s_[:, :BORDER], np.s_[:, -BORDER:]):
        image[side] = colour
    return image


def _stacked(images: list[Rgb], axis: int) -> Rgb:
    shape = list(images[0].shape)
    shape[axis] = GAP
    gap = np.full(shape, palette.BACKGROUND, np.uint8)
    return np.concatenate([images[0], gap, images[1]], axis=axis)


def _draw(image: Rgb, lines: WaypointOutline, colour: Rgb8) -> None:
    """Draw a waypoint's lines with a dark rim, so that they are visible on any wall."""
    for thickness, ink in ((9, _DARK), (4, colour)):
        for line in lines:
            _polyline(image, line * SCALE, ink, thickness)


def _polyline(image: Rgb, points: NDArray[np.float64], ink: Rgb8, thickness: int) -> None:
    for start, end in pairwise(points):
        if np.isfinite([start, end]).all() and max(np.abs(start).max(), np.abs(end).max()) < _OUT_OF_SIGHT_PX:
            ends = [(round(column), round(row)) for column, row in (start.tolist(), end.tolist())]
            cv2.line(image, ends[0], ends[1], tuple(ink), thickness, cv2.LINE_AA)


FARTHEST_M = 4.0
"""Upper end of the slider in metres; at this end, the distance has no upper limit."""

ALL = "all pairs"
REACHABLE = "reachable"
UNREACHABLE = "not reachable"
MOVES: dict[str, PairCommand] = {"Previous": StepPairs(-1), "Next": StepPairs(1), "Random": JumpToRandomPair()}

_STYLE = f"""<style>
.lp-key {{ display: flex; justify-content: space-between; color: var(--ltvn-soft); }}
.lp-key b {{ color: var(--ltvn-strong); font-weight: 600; }}
.lp-chip {{ display: inline-block; width: .8em; height: .8em; border-radius: 2px; margin-right: .4em;
  vertical-align: -1px; }}
.lp-verdict {{ display: flex; flex-wrap: wrap; gap: .3em .7em; align-items: center; color: var(--ltvn-soft); }}
.lp-label {{ padding: .1em .8em; border-radius: 1em; font-weight: 600; color: #fff; background: #1864ab; }}
.lp-label[data-reachable="0"] {{ background: #9a4310; }}
.lp-why {{ margin: .35em 0 0; min-height: 1.45em; padding: 0; list-style: none; color: var(--ltvn-text); }}
.lp-why b {{ --ltvn-ink: {palette.TARGET.css}; font-weight: 600; }}
</style>"""


class PairPanel:
    """Shows a pair and sends commands."""

    def __init__(self, gui: viser.GuiApi, scenes: Sequence[str], send: Callable[[PairCommand], None]) -> None:
        """Add the widgets to the main panel; `send` takes commands and returns at once."""
        gui.add_html(STYLE + _STYLE)
        HtmlBlock(gui, _key())
        self._image = gui.add_image(blank_pair_image(), format="jpeg", jpeg_quality=90)
        self._moves = gui.add_button_group("Pair", list(MOVES), hint="or press P, N, R")
        self._verdict = HtmlBlock(gui)
        self._numbers = HtmlBlock(gui)
        self._scene = gui.add_dropdown("Scene", list(scenes))
        self._kind = gui.add_dropdown("Show", list(_kinds()))
        self._range = gui.add_multi_slider(
            "Metres apart", 0.0, FARTHEST_M, 0.1, (0.0, FARTHEST_M), min_range=0.1, hint="the far end means any"
        )
        self._disagreeing = gui.add_checkbox("Network disagrees", False)
        self._bind(gui, send)

    def show(self, shown_pair: ShownPair) -> None:
        """Show a pair with its label and the network's prediction."""
        if shown_pair.pair is None:
            self._image.image = blank_pair_image()
            self._verdict.show(_card("No pair passes these filters."))
            self._numbers.show("")
            return
        self._image.image = pair_image(shown_pair.pair, shown_pair.waypoint)
        self._verdict.show(_verdict(shown_pair, shown_pair.pair))
        self._numbers.show(_numbers(shown_pair, shown_pair.pair))

    def show_busy(self, text: str) -> None:
        """Show what is being computed."""
        self._verdict.show(_card(text))

    def show_error(self, problem: str) -> None:
        """Show an error."""
        self._verdict.show(_card(problem, severity="ERROR"))

    def pair_filter(self) -> PairFilter:
        """Return the filter that the controls describe."""
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
    """Return the filter for each entry of the list of kinds: the label, and the failed criterion."""
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
        f'<li><b class="lp-criterion lt-inked">{escape(reason.name)}</b> {escape(reason.text)}</li>'
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
