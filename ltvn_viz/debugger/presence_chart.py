"""Chart of p(open) of an edge over the clock of the world, as an SVG with the observations of the edge.

Owns the drawing. The data are a `PresenceChart` of `ltvn_core.analysis.answer`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.analysis.answer import LookMark, PresenceChart
from ltvn_core.analysis.world_clock import DAY_S, clock_text
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE

_WIDTH_PX = 360
_HEIGHT_PX = 146
_LEFT_PX = 34
_RIGHT_PX = 8
_TOP_PX = 20
_BOTTOM_PX = 38
_TICK_STEPS_S = (60, 300, 600, 1800, 3600, 3 * 3600, 6 * 3600, 12 * 3600, DAY_S, 2 * DAY_S, 7 * DAY_S)
_MOST_TICKS = 4
_INK = "#a6a7ab"


class _Frame(NamedTuple):
    """Conversion of times and probabilities to pixels."""

    first_s: float
    last_s: float

    def x(self, at_s: float) -> float:
        """Return the column of a time."""
        share = (at_s - self.first_s) / (self.last_s - self.first_s)
        return _LEFT_PX + share * (_WIDTH_PX - _LEFT_PX - _RIGHT_PX)

    def y(self, p: float) -> float:
        """Return the row of a probability."""
        return _TOP_PX + (1 - p) * (_HEIGHT_PX - _TOP_PX - _BOTTOM_PX)


def presence_svg(chart: PresenceChart) -> str:
    """Return p(open) over the clock of the world as an SVG; predictions after `now` are dashed."""
    frame = _Frame(chart.points[0][0], max(chart.points[-1][0], chart.points[0][0] + 1.0))
    past = [point for point in chart.points if point[0] <= chart.now]
    ahead = past[-1:] + [point for point in chart.points if point[0] > chart.now]
    label = "probability that the edge is open, over time"
    return (
        f'<svg viewBox="0 0 {_WIDTH_PX} {_HEIGHT_PX}" role="img" aria-label="{label}" class="lt-curve">'
        f"{_axes(frame)}{_now(frame, chart.now)}{_line(frame, past)}{_line(frame, ahead, dashed=True)}"
        f"{_marks(frame, chart.looks)}</svg>"
    )


def _line(frame: _Frame, points: Sequence[tuple[float, float]], *, dashed: bool = False) -> str:
    if len(points) < 2:
        return ""
    way = "L".join(f"{frame.x(at_s):.1f} {frame.y(p):.1f}" for at_s, p in points)
    style = ' stroke-dasharray="4 3"' if dashed else ""
    return f'<path d="M{way}" fill="none" stroke="{palette.SOURCE.css}" stroke-width="2"{style}/>'


def _marks(frame: _Frame, looks: Sequence[LookMark]) -> str:
    """Return a mark for each observation: above the line p = 1 if open, below the line p = 0 if blocked."""
    marks = ""
    for look in looks:
        if frame.first_s <= look.time <= frame.last_s:
            colour = palette.EDGE_ADDED if look.is_open else palette.EDGE_REMOVED
            row = frame.y(1.0) if look.is_open else frame.y(0.0)
            words = f"seen {'open' if look.is_open else 'blocked'}, {clock_text(look.time)}"
            marks += (
                f'<circle cx="{frame.x(look.time):.1f}" cy="{row:.1f}" r="3.5" fill="{colour.css}">'
                f"<title>{words}</title></circle>"
            )
    return marks


def _now(frame: _Frame, now_s: float) -> str:
    x = frame.x(now_s)
    anchor = "end" if x > 0.8 * _WIDTH_PX else "start"
    return (
        f'<path d="M{x:.1f} {_TOP_PX - 4}V{frame.y(0.0):.1f}" stroke="white" stroke-width="1.5"/>'
        f'<text x="{x + (-3 if anchor == "end" else 3):.1f}" y="{_TOP_PX - 3}" font-size="13" text-anchor="{anchor}" '
        f'fill="white">now</text>'
    )


def _axes(frame: _Frame) -> str:
    bottom = frame.y(0.0)
    right = _WIDTH_PX - _RIGHT_PX
    rules = "".join(
        f'<text x="{_LEFT_PX - 4}" y="{frame.y(p) + 3:.1f}" font-size="13" text-anchor="end" fill="{_INK}">{p:g}</text>'
        for p in (0.0, OPEN_ABOVE, 1.0)
    )
    threshold = frame.y(OPEN_ABOVE)
    ticks = "".join(_tick(frame, at_s, bottom) for at_s in _ticks(frame))
    is_clock = clock_text(frame.first_s).startswith("day")
    unit = f"{clock_text(frame.first_s).split(',')[0]} …, hours" if is_clock else "seconds"
    return (
        f'<path d="M{_LEFT_PX} {_TOP_PX}V{bottom:.1f}H{right}" fill="none" stroke="#868e96"/>'
        f'<path d="M{_LEFT_PX} {threshold:.1f}H{right}" stroke="#868e96" stroke-dasharray="4 3"/>{rules}{ticks}'
        f'<text x="{_LEFT_PX + 4}" y="{_TOP_PX - 3}" font-size="13" fill="{_INK}">p open</text>'
        f'<text x="{right}" y="{_HEIGHT_PX - 3}" font-size="13" text-anchor="end" fill="{_INK}">{unit}</text>'
    )


def _ticks(frame: _Frame) -> list[float]:
    span = frame.last_s - frame.first_s
    step = next((step for step in _TICK_STEPS_S if span / step <= _MOST_TICKS), span / _MOST_TICKS)
    first = int(frame.first_s // step) + 1
    return [number * step for number in range(first, int(frame.last_s // step) + 1)]


def _tick(frame: _Frame, at_s: float, bottom: float) -> str:
    words = clock_text(at_s)
    words = words.split(", ")[-1] if at_s % DAY_S or frame.last_s - frame.first_s < DAY_S else words.split(",")[0]
    return (
        f'<path d="M{frame.x(at_s):.1f} {bottom:.1f}v4" stroke="#868e96"/>'
        f'<text x="{frame.x(at_s):.1f}" y="{bottom + 17:.1f}" font-size="13" text-anchor="middle" '
        f'fill="{_INK}">{words}</text>'
    )
