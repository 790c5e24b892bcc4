"""A strip of marks over time, one row for each kind, as a small SVG.

Owns the picture and which kind has which colour and name.
"""

from collections.abc import Mapping, Sequence
from html import escape

from ltvn_core import palette
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.context import DebugContext

MARK_STYLES: Mapping[MarkKind, tuple[str, Rgb8]] = {
    MarkKind.QUERY_START: ("query", palette.SOURCE),
    MarkKind.REPLAN: ("new plan", palette.PLAN),
    MarkKind.FAILURE: ("failed leg", palette.TARGET),
    MarkKind.COLLISION: ("collision", palette.GOAL),
    MarkKind.PRUNE: ("pruned", palette.EDGE_REMOVED),
    MarkKind.EXPAND: ("new node", palette.EDGE_ADDED),
}
"""The kinds that are shown, from top to bottom."""
_WIDTH_PX, _ROW_PX = 340, 9


def mark_timeline_svg(context: DebugContext) -> str:
    """Return the strip of all marks that are known, with a line at the moment; as large as it is wide at most."""
    timeline = context.timeline
    until = max(timeline.instant(len(timeline.events) - 1).stamp, context.moment.stamp)
    span = max(until - context.start_s, 1e-9)
    rows = "".join(
        _row(timeline.marks_until(None, kind), name, colour, row, context.start_s, span)
        for row, (kind, (name, colour)) in enumerate(MARK_STYLES.items())
    )
    now, height = _column(context.moment.stamp, context.start_s, span), _ROW_PX * len(MARK_STYLES)
    line = f'<path d="M{now} 0v{height}" stroke="rgb(255,255,255)" stroke-width="1.5"/>'
    size = f'viewBox="0 0 {_WIDTH_PX} {height}"'
    return f'<svg {size} role="img" aria-label="marks over time" class="lt-curve">{rows}{line}</svg>'


def _row(marks: Sequence[Mark], name: str, colour: Rgb8, row: int, start_s: float, span: float) -> str:
    # However many marks there are, there are no more columns than this.
    columns = sorted({_column(mark.instant.stamp, start_s, span) for mark in marks})
    ticks = "".join(f"M{column} {row * _ROW_PX + 1}v{_ROW_PX - 2}" for column in columns)
    title = f"<title>{escape(name)}: {len(marks)}</title>"
    return f'<path d="{ticks}" stroke="{colour.css}" stroke-width="2">{title}</path>' if ticks else ""


def _column(stamp: float, start_s: float, span: float) -> int:
    share = min(max((stamp - start_s) / span, 0.0), 1.0)
    return round(2 + share * (_WIDTH_PX - 4))
