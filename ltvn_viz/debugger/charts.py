"""Small charts inside an answer, as SVG: axes with numbers and units, named limits, and a line at the moment on show.

Owns the drawing. What is drawn comes from `ltvn_core.analysis`; pictures are `svg_figures`.
"""

from collections.abc import Sequence
from html import escape
from math import ceil, floor, log10
from typing import NamedTuple

from ltvn_core.palette import Rgb8

WIDTH_PX, HEIGHT_PX = 360, 150
_LEFT_PX, _RIGHT_PX, _TOP_PX, _BOTTOM_PX = 34, 10, 20, 36
_FONT_PX = 13
_INK, _RULE = "#b6b8bb", "#868e96"
_HALO = 'paint-order="stroke" stroke="#212226" stroke-width="4"'
"""Keeps words apart from a line behind them."""


class Axis(NamedTuple):
    """What one direction of a chart shows, and from where to where."""

    label: str
    """With its unit."""
    first: float
    last: float

    def share(self, value: float) -> float:
        """Return where a value lies, 0 at the first and 1 at the last."""
        return (value - self.first) / max(self.last - self.first, 1e-9)

    @property
    def ticks(self) -> list[float]:
        """Two to six round numbers."""
        span = max(self.last - self.first, 1e-9)
        step = 10.0 ** floor(log10(span))
        step = next(each for each in (step / 5, step / 2, step, 2 * step) if span / each <= 5 or each == 2 * step)
        first, last = ceil(self.first / step - 1e-6), floor(self.last / step + 1e-6)
        return [k * step for k in range(first, last + 1)]


PROBABILITY = (0.0, 1.0)


def step_chart_svg(
    points: Sequence[tuple[float, float]],
    x: Axis,
    y: Axis,
    *,
    colour: Rgb8,
    lines: Sequence[tuple[float, str]] = (),
    now: float | None = None,
) -> str:
    """Return steps through points (x, y), with named horizontal lines, and a line at `now`, as an SVG.

    The last value holds until `now`, or until the end of the axis where there is no such moment.
    """
    if not points:
        return ""
    end = x.last if now is None else min(max(now, points[-1][0]), x.last)
    way = f"M{_u(x, points[0][0])} {_v(y, points[0][1])}"
    way += "".join(f"H{_u(x, at)}V{_v(y, value)}" for at, value in points[1:]) + f"H{_u(x, end)}"
    label = f"{y.label} over {x.label}"
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" role="img" aria-label="{escape(label)}" class="lt-curve" '
        f'font-size="{_FONT_PX}">{_axes(x, y)}<path d="{way}" fill="none" stroke="{colour.css}" stroke-width="2"/>'
        f"{_dots(points, x, y, colour)}{_limits(y, lines)}{'' if now is None else _now(x, now)}</svg>"
    )


def _u(x: Axis, value: float) -> str:
    return f"{_LEFT_PX + min(max(x.share(value), 0.0), 1.0) * (WIDTH_PX - _LEFT_PX - _RIGHT_PX):.1f}"


def _v(y: Axis, value: float) -> str:
    return f"{_TOP_PX + (1 - min(max(y.share(value), 0.0), 1.0)) * (HEIGHT_PX - _TOP_PX - _BOTTOM_PX):.1f}"


def _dots(points: Sequence[tuple[float, float]], x: Axis, y: Axis, colour: Rgb8) -> str:
    """Mark each point where they are few, with its numbers on hover."""
    if len(points) > 40:
        return ""
    return "".join(
        f'<circle cx="{_u(x, at)}" cy="{_v(y, value)}" r="3" fill="{colour.css}">'
        f"<title>{escape(x.label)} {at:g}: {escape(y.label)} {value:.2f}</title></circle>"
        for at, value in ((round(at, 1), value) for at, value in points)
    )


def _axes(x: Axis, y: Axis) -> str:
    bottom, right = HEIGHT_PX - _BOTTOM_PX, WIDTH_PX - _RIGHT_PX
    parts = [f'<path d="M{_LEFT_PX} {_TOP_PX}V{bottom}H{right}" fill="none" stroke="{_RULE}"/>']
    for tick in y.ticks:
        parts.append(_text(_LEFT_PX - 5, float(_v(y, tick)) + 4, f"{tick:g}", "end"))
    for tick in x.ticks:
        at = _u(x, tick)
        parts.append(f'<path d="M{at} {bottom}v4" stroke="{_RULE}"/>')
        parts.append(_text(float(at), bottom + 17, f"{tick:g}", "middle"))
    parts.append(_text(2, 13, y.label, "start"))
    parts.append(_text(right, HEIGHT_PX - 4, x.label, "end"))
    return "".join(parts)


def _limits(y: Axis, lines: Sequence[tuple[float, str]]) -> str:
    return "".join(
        f'<path d="M{_LEFT_PX} {_v(y, at)}H{WIDTH_PX - _RIGHT_PX}" stroke="{_RULE}" stroke-dasharray="4 3"/>'
        + _text(_LEFT_PX + 4, float(_v(y, at)) - 4, name, "start").replace("<text", f"<text {_HALO}", 1)
        for at, name in lines
    )


def _now(x: Axis, now: float) -> str:
    at = float(_u(x, now))
    anchor, shift = ("end", -4) if x.share(now) > 0.8 else ("start", 4)
    line = f'<path d="M{at:.1f} {_TOP_PX - 6}V{HEIGHT_PX - _BOTTOM_PX}" stroke="white" stroke-width="1.5"/>'
    return line + _text(at + shift, _TOP_PX - 6, "now", anchor, "white")


def _text(x: float, y: float, words: str, anchor: str, colour: str = _INK) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{escape(words)}</text>'


def calibration_svg(cells: Sequence[tuple[float, float, int]], colour: Rgb8) -> str:
    """Return what was foretold against what is true, both in [0, 1], as dots as large as their counts, as an SVG."""
    x, y = Axis("p, as believed", *PROBABILITY), Axis("share of these edges that can be driven", *PROBABILITY)
    most = max((count for *_, count in cells), default=1)
    dots = "".join(
        f'<circle cx="{_u(x, said)}" cy="{_v(y, true)}" r="{2 + 5 * (count / most) ** 0.5:.1f}" fill="{colour.css}">'
        f"<title>p {said:.2f}, true {true:.2f}, {count} edges</title></circle>"
        for said, true, count in cells
    )
    promise = f'<path d="M{_u(x, 0)} {_v(y, 0)}L{_u(x, 1)} {_v(y, 1)}" stroke="{_RULE}" stroke-dasharray="4 3"/>'
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" role="img" aria-label="{escape(y.label)} over p" class="lt-curve" '
        f'font-size="{_FONT_PX}">{_axes(x, y)}{promise}{dots}</svg>'
    )
