"""Small charts inside an answer, as SVG: axes with numbers and units, named limits, marks, and a line at the moment.

Owns the drawing. The data are a chart of `ltvn_core.analysis.answer`.
"""

from collections.abc import Sequence
from html import escape
from math import ceil, floor, log10
from typing import TypeAlias, assert_never

from ltvn_core import palette
from ltvn_core.analysis.answer import (
    PROBABILITY,
    Axis,
    CalibrationChart,
    Chart,
    PresenceChart,
    StepChart,
)
from ltvn_core.analysis.world_clock import DAY_S, clock_text
from ltvn_core.graph.presence.edge_presence import OPEN_ABOVE
from ltvn_core.palette import Rgb8

WIDTH_PX = 360
HEIGHT_PX = 156
_LEFT_PX = 44
_RIGHT_PX = 10
_TOP_PX = 26
_BOTTOM_PX = 36
_TITLE_ROW_PX = 13
"""Baseline of the title of the y-axis, clear of the top number."""
_FONT_PX = 13
_INK = "#b6b8bb"
_RULE = "#868e96"
_DASHES = f'stroke="{_RULE}" stroke-dasharray="4 3"'
_LETTER_PX = 7
"""Approximate width of a letter in pixels."""
_CLOCK_STEPS_S = (60, 300, 600, 1800, 3600, 3 * 3600, 6 * 3600, 12 * 3600, DAY_S, 2 * DAY_S, 7 * DAY_S)
_MOST_CLOCK_TICKS = 4
_Points: TypeAlias = Sequence[tuple[float, float]]


def chart_svg(chart: Chart) -> str:
    """Return a chart as an SVG; empty if there is nothing to draw."""
    match chart:
        case StepChart():
            return _step_chart_svg(chart)
        case CalibrationChart():
            return _calibration_svg(chart)
        case PresenceChart():
            return _presence_svg(chart)
        case _:
            assert_never(chart)


def _svg(label: str, body: str) -> str:
    size = f'viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}"'
    return f'<svg {size} role="img" aria-label="{escape(label)}" class="lt-curve" font-size="{_FONT_PX}">{body}</svg>'


def _step_chart_svg(chart: StepChart) -> str:
    """Draw steps; the last value continues to `now`, or to the end of the axis if `now` is not set."""
    points, x, y, now = chart.points, chart.x, chart.y, chart.now
    if not points:
        return ""
    end = x.last if now is None else min(max(now, points[-1][0]), x.last)
    way = f"M{_u(x, points[0][0])} {_v(y, points[0][1])}"
    way += "".join(f"H{_u(x, at)}V{_v(y, value)}" for at, value in points[1:]) + f"H{_u(x, end)}"
    line = f'<path d="{way}" fill="none" stroke="{chart.colour.css}" stroke-width="2"/>'
    # Too many points would hide the line.
    dots = [] if len(points) > 40 else [(round(at, 1), value) for at, value in points]
    body = _axes(x, y) + line
    for at, value in dots:
        body += _dot(x, y, at, value, chart.colour, f"{x.label} {at:g}: {y.label} {value:.2f}")
    return _svg(f"{y.label} over {x.label}", body + _limits(y, chart.limits) + ("" if now is None else _now(x, now)))


def _presence_svg(chart: PresenceChart) -> str:
    """Draw p(open) over the clock of the world, dashed after `now`.

    A mark for each observation lies on the line p = 1 if the edge was seen open, on the line p = 0 if blocked.
    """
    first_s, last_s = chart.points[0][0], max(chart.points[-1][0], chart.points[0][0] + 1.0)
    is_clock = clock_text(first_s).startswith("day")
    x = Axis(f"{clock_text(first_s).split(',')[0]} …, hours" if is_clock else "seconds", first_s, last_s)
    y = Axis("p open", *PROBABILITY)
    past = [point for point in chart.points if point[0] <= chart.now]
    ahead = past[-1:] + [point for point in chart.points if point[0] > chart.now]
    body = _axes(x, y, _clock_ticks(x)) + _limits(y, ((OPEN_ABOVE, "counts as open"),)) + _now(x, chart.now)
    body += _curve(x, y, past) + _curve(x, y, ahead, ' stroke-dasharray="4 3"')
    for look in chart.looks:
        if first_s <= look.stamp_s <= last_s:
            colour = palette.EDGE_ADDED if look.present else palette.EDGE_REMOVED
            words = f"seen {'open' if look.present else 'blocked'}, {clock_text(look.stamp_s)}"
            body += _dot(x, y, look.stamp_s, float(look.present), colour, words)
    return _svg("probability that the edge is open, over time", body)


def _clock_ticks(x: Axis) -> list[tuple[float, str]]:
    """Return a few round times with their texts: the time of day, or the day at midnight of a longer axis."""
    span_s = x.last - x.first
    step = next((step for step in _CLOCK_STEPS_S if span_s / step <= _MOST_CLOCK_TICKS), span_s / _MOST_CLOCK_TICKS)
    times = [number * step for number in range(int(x.first // step) + 1, int(x.last // step) + 1)]
    is_long = span_s >= DAY_S
    return [(at, clock_text(at).split(",")[0 if is_long and at % DAY_S == 0 else -1].strip()) for at in times]


def _curve(x: Axis, y: Axis, points: _Points, style: str = "") -> str:
    if len(points) < 2:
        return ""
    way = "L".join(f"{_u(x, at)} {_v(y, value)}" for at, value in points)
    return f'<path d="M{way}" fill="none" stroke="{palette.SOURCE.css}" stroke-width="2"{style}/>'


def _dot(x: Axis, y: Axis, at: float, value: float, colour: Rgb8, words: str, radius: str = "3") -> str:
    """Draw a dot that says its words on hover."""
    place = f'cx="{_u(x, at)}" cy="{_v(y, value)}" r="{radius}"'
    return f'<circle {place} fill="{colour.css}"><title>{escape(words)}</title></circle>'


def axis_ticks(axis: Axis) -> list[float]:
    """Return two to six round numbers, or fewer on a short axis of whole numbers."""
    span = max(axis.last - axis.first, 1e-9)
    step = 10.0 ** floor(log10(span))
    step = next(each for each in (step / 5, step / 2, step, 2 * step) if span / each <= 5 or each == 2 * step)
    step = max(step, 1.0) if axis.is_count else step
    first = ceil(axis.first / step - 1e-6)
    last = floor(axis.last / step + 1e-6)
    return [k * step for k in range(first, last + 1)]


def _u(x: Axis, value: float) -> str:
    return f"{_LEFT_PX + min(max(x.share(value), 0.0), 1.0) * (WIDTH_PX - _LEFT_PX - _RIGHT_PX):.1f}"


def _v(y: Axis, value: float) -> str:
    return f"{_TOP_PX + (1 - min(max(y.share(value), 0.0), 1.0)) * (HEIGHT_PX - _TOP_PX - _BOTTOM_PX):.1f}"


def _axes(x: Axis, y: Axis, x_ticks: Sequence[tuple[float, str]] | None = None) -> str:
    bottom = HEIGHT_PX - _BOTTOM_PX
    right = WIDTH_PX - _RIGHT_PX
    parts = [f'<path d="M{_LEFT_PX} {_TOP_PX}V{bottom}H{right}" fill="none" stroke="{_RULE}"/>']
    for tick in axis_ticks(y):
        parts.append(_text(_LEFT_PX - 5, float(_v(y, tick)) + 4, f"{tick:g}", "end"))
    for tick, words in [(at, f"{at:g}") for at in axis_ticks(x)] if x_ticks is None else x_ticks:
        at = _u(x, tick)
        parts.append(f'<path d="M{at} {bottom}v4" stroke="{_RULE}"/>')
        parts.append(_text(float(at), bottom + 17, words, "middle"))
    parts.append(_text(2, _TITLE_ROW_PX, y.label, "start"))
    parts.append(_text(right, HEIGHT_PX - 4, x.label, "end"))
    return "".join(parts)


def _limits(y: Axis, lines: Sequence[tuple[float, str]]) -> str:
    """Draw a dashed line for each limit, with its name below the axes, where no curve can run through the words."""
    parts = []
    left = 2.0
    row = HEIGHT_PX - 4
    for at, name in lines:
        parts.append(f'<path d="M{_LEFT_PX} {_v(y, at)}H{WIDTH_PX - _RIGHT_PX}" {_DASHES}/>')
        parts.append(f'<path d="M{left:.1f} {row - 4}h18" {_DASHES}/>')
        parts.append(_text(left + 22, row, name, "start"))
        left += 34 + _LETTER_PX * len(name)
    return "".join(parts)


def _now(x: Axis, now: float) -> str:
    at = float(_u(x, now))
    anchor, shift = ("end", -4) if x.share(now) > 0.8 else ("start", 4)
    line = f'<path d="M{at:.1f} {_TOP_PX - 6}V{HEIGHT_PX - _BOTTOM_PX}" stroke="white" stroke-width="1.5"/>'
    return line + _text(at + shift, _TITLE_ROW_PX, "now", anchor, "white")


def _text(x: float, y: float, words: str, anchor: str, colour: str = _INK) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{escape(words)}</text>'


def _calibration_svg(chart: CalibrationChart) -> str:
    """Draw predicted against true shares, as dots whose size follows their counts."""
    x = Axis("p, as believed", *PROBABILITY)
    y = Axis("share of these edges that can be driven", *PROBABILITY)
    most = max((count for *_, count in chart.cells), default=1)
    promise = f'<path d="M{_u(x, 0)} {_v(y, 0)}L{_u(x, 1)} {_v(y, 1)}" {_DASHES}/>'
    dots = (
        _dot(
            *(x, y, said, true, chart.colour),
            f"p {said:.2f}, true {true:.2f}, {count} edges",
            f"{2 + 5 * (count / most) ** 0.5:.1f}",
        )
        for said, true, count in chart.cells
    )
    return _svg(f"{y.label} over p", _axes(x, y) + promise + "".join(dots))
