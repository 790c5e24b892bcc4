"""Small charts inside an answer, as SVG: axes with numbers and units, named limits, and a line at the current moment.

Owns the drawing. The data are a chart of `ltvn_core.analysis.answer`.
"""

from collections.abc import Sequence
from html import escape
from math import ceil, floor, log10
from typing import assert_never

from ltvn_core.analysis.answer import (
    PROBABILITY,
    Axis,
    CalibrationChart,
    Chart,
    LaneChart,
    MarkLane,
    PresenceChart,
    StepChart,
)
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.presence_chart import presence_svg

WIDTH_PX = 360
HEIGHT_PX = 156
_LANE_PX = 9
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


def chart_svg(chart: Chart) -> str:
    """Return a chart as an SVG; empty if there is nothing to draw."""
    match chart:
        case StepChart():
            return _step_chart_svg(chart)
        case CalibrationChart():
            return _calibration_svg(chart)
        case LaneChart():
            return _lanes_svg(chart)
        case PresenceChart():
            return presence_svg(chart)
        case _:
            assert_never(chart)


def _step_chart_svg(chart: StepChart) -> str:
    """Draw steps; the last value continues to `now`, or to the end of the axis if `now` is not set."""
    points = chart.points
    x = chart.x
    y = chart.y
    now = chart.now
    if not points:
        return ""
    end = x.last if now is None else min(max(now, points[-1][0]), x.last)
    way = f"M{_u(x, points[0][0])} {_v(y, points[0][1])}"
    way += "".join(f"H{_u(x, at)}V{_v(y, value)}" for at, value in points[1:]) + f"H{_u(x, end)}"
    label = f"{y.label} over {x.label}"
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" role="img" aria-label="{escape(label)}" class="lt-curve" '
        f'font-size="{_FONT_PX}">{_axes(x, y)}'
        f'<path d="{way}" fill="none" stroke="{chart.colour.css}" stroke-width="2"/>'
        f"{_dots(points, x, y, chart.colour)}{_limits(y, chart.limits)}{'' if now is None else _now(x, now)}</svg>"
    )


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


def _dots(points: Sequence[tuple[float, float]], x: Axis, y: Axis, colour: Rgb8) -> str:
    """Draw a dot for each point, with its numbers on hover; draw no dots if there are too many points."""
    if len(points) > 40:
        return ""
    return "".join(
        f'<circle cx="{_u(x, at)}" cy="{_v(y, value)}" r="3" fill="{colour.css}">'
        f"<title>{escape(x.label)} {at:g}: {escape(y.label)} {value:.2f}</title></circle>"
        for at, value in ((round(at, 1), value) for at, value in points)
    )


def _axes(x: Axis, y: Axis) -> str:
    bottom = HEIGHT_PX - _BOTTOM_PX
    right = WIDTH_PX - _RIGHT_PX
    parts = [f'<path d="M{_LEFT_PX} {_TOP_PX}V{bottom}H{right}" fill="none" stroke="{_RULE}"/>']
    for tick in axis_ticks(y):
        parts.append(_text(_LEFT_PX - 5, float(_v(y, tick)) + 4, f"{tick:g}", "end"))
    for tick in axis_ticks(x):
        at = _u(x, tick)
        parts.append(f'<path d="M{at} {bottom}v4" stroke="{_RULE}"/>')
        parts.append(_text(float(at), bottom + 17, f"{tick:g}", "middle"))
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
    dots = "".join(
        f'<circle cx="{_u(x, said)}" cy="{_v(y, true)}" r="{2 + 5 * (count / most) ** 0.5:.1f}" '
        f'fill="{chart.colour.css}"><title>p {said:.2f}, true {true:.2f}, {count} edges</title></circle>'
        for said, true, count in chart.cells
    )
    promise = f'<path d="M{_u(x, 0)} {_v(y, 0)}L{_u(x, 1)} {_v(y, 1)}" stroke="{_RULE}" stroke-dasharray="4 3"/>'
    return (
        f'<svg viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" role="img" aria-label="{escape(y.label)} over p" class="lt-curve" '
        f'font-size="{_FONT_PX}">{_axes(x, y)}{promise}{dots}</svg>'
    )


def _lanes_svg(chart: LaneChart) -> str:
    """Draw a named row of ticks for each lane, and a line at the moment on show."""
    height = _LANE_PX * len(chart.lanes)
    rows = "".join(_lane(lane, chart.time, row) for row, lane in enumerate(chart.lanes))
    now = _lane_column(chart.time, chart.now)
    line = f'<path d="M{now} 0v{height}" stroke="white" stroke-width="1.5"/>'
    size = f'viewBox="0 0 {WIDTH_PX} {height}"'
    return f'<svg {size} role="img" aria-label="marks over time" class="lt-curve">{rows}{line}</svg>'


def _lane(lane: MarkLane, time: Axis, row: int) -> str:
    # Marks in the same column are merged, which limits the size of the SVG.
    columns = sorted({_lane_column(time, at) for at in lane.times})
    ticks = "".join(f"M{column} {row * _LANE_PX + 1}v{_LANE_PX - 2}" for column in columns)
    title = f"<title>{escape(lane.name)}: {len(lane.times)}</title>"
    return f'<path d="{ticks}" stroke="{lane.colour.css}" stroke-width="2">{title}</path>' if ticks else ""


def _lane_column(time: Axis, at: float) -> int:
    return round(2 + min(max(time.share(at), 0.0), 1.0) * (WIDTH_PX - 4))
