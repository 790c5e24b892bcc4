"""The robot's life as small curves: success, nodes and edges over queries, and what changed around a dip.

Owns the drawing. The numbers are `ltvn_core.analysis.lifelong_success`.
"""

from collections import Counter
from collections.abc import Sequence
from html import escape

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.lifelong_success import LifelongSuccess, SuccessDip
from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.charts import Axis, step_chart_svg
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.session.commands import PointAt

_POINTS = 200
_DIPS = 3
_EDGES = 5


def add_lifelong_curves(context: DebugContext, strip: LifelongSuccess, builder: AnswerBuilder) -> None:
    """Add the curves and the dips to a page; nothing for a single query."""
    if len(strip.queries) < 2:
        return
    over = sum(end.step <= context.step for end in strip.ends)
    now = f"{100 * strip.success[over - 1]:.0f} %" if over else "–"
    builder.add_html(f"<div>Success over the last queries, now <b>{now}</b>:</div>")
    builder.add_html(_chart(strip.success, "share that arrived", palette.SOURCE, over))
    for name, counts, colour in (("nodes", strip.nodes, palette.NODE), ("edges", strip.edges, palette.PLAN)):
        builder.add_html(_chart(counts, name, colour, over))
    for dip in sorted(strip.dips, key=lambda dip: -dip.fall)[:_DIPS]:
        _dip(context, strip, dip, builder)


def _chart(values: Sequence[float] | np.ndarray, label: str, colour: Rgb8, over: int) -> str:
    """Draw one value after each query (Q,), with a line behind the last of the `over` that are over."""
    rows = np.unique(np.linspace(0, len(values) - 1, min(len(values), _POINTS)).astype(np.intp))
    points = [(float(row + 1), float(values[row])) for row in rows]
    x = Axis("queries", 1.0, float(len(values)))
    y = Axis(label, 0.0, max(1.0, float(np.max(values))))
    return step_chart_svg(points, x, y, colour=colour, now=float(over) if 0 < over < len(values) else None)


def _dip(context: DebugContext, strip: LifelongSuccess, dip: SuccessDip, builder: AnswerBuilder) -> None:
    """Say where success fell, and what happened to the map on the way down."""
    first, last = strip.queries[dip.peak], strip.queries[dip.low]
    ends = [
        builder.time_link(context.seconds(dip.before), f"query {first}"),
        builder.time_link(context.seconds(dip.after), f"query {last}"),
    ]
    within = slice(dip.peak + 1, dip.low + 1)
    counts = [int(column[within].sum()) for column in (strip.pruned, strip.edges_added, strip.nodes_added)]
    builder.add_html(
        f"<div><b>Dip:</b> success fell by {100 * dip.fall:.0f} % from {ends[0]} to {ends[1]}; meanwhile "
        f"{counts[0]} edges went, {counts[1]} edges and {counts[2]} nodes came.</div>"
    )
    touched = _touched(context, dip)
    if touched:
        links = (f"{builder.link(f'{s} → {t}', PointAt(s, t))} {escape(what)}" for (s, t), what in touched)
        builder.add_html(f"<div>Edges it touched most: {', '.join(links)}.</div>")


def _touched(context: DebugContext, dip: SuccessDip) -> list[tuple[EdgeKey, str]]:
    """Return the edges that changed most often in a dip, and how each ended; pruned ones first."""
    timeline, counts, ends = context.timeline, Counter[EdgeKey](), dict[EdgeKey, str]()
    first = timeline.change_count_before(timeline.count_until(dip.before))
    for change in timeline.changes_until(dip.after)[first:]:
        delta = change.delta
        match delta:
            case EdgePruned():
                edge, what = (delta.source, delta.target), "pruned"
            case BeliefUpdated():
                edge, what = (delta.source, delta.target), f"then p {delta.belief.p:.2f}"
            case EdgeAdded():
                edge, what = (delta.edge.source, delta.edge.target), "new"
            case _:
                continue
        counts[edge] += 1
        ends[edge] = what
    ranked = sorted(counts, key=lambda edge: (ends[edge] != "pruned", -counts[edge]))
    return [(edge, ends[edge]) for edge in ranked[:_EDGES]]
