"""The robot's life as small curves: success, nodes and edges over queries, and what changed around a dip.

Owns the drawing. The numbers are `ltvn_core.analysis.strip`.
"""

from collections import Counter
from collections.abc import Sequence
from html import escape

import numpy as np

from ltvn_core.analysis.strip import Dip, LifelongStrip
from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned
from ltvn_viz import palette
from ltvn_viz.commands import PointAt
from ltvn_viz.palette import Rgb8
from ltvn_viz.why.case import Case
from ltvn_viz.why.pictures import curve
from ltvn_viz.why.tool import EdgeKey, Page

_POINTS = 200
_DIPS = 3
_EDGES = 5


def show_life(case: Case, strip: LifelongStrip, page: Page) -> None:
    """Add the curves and the dips to a page; nothing for a single query."""
    if len(strip.queries) < 2:
        return
    now = f"{100 * strip.success[-1]:.0f} %"
    page.html(f"<div>Success over the last queries, now <b>{now}</b>:</div>{_curve(strip.success, palette.SOURCE)}")
    for name, counts, colour in (("Nodes", strip.nodes, palette.NODE), ("Edges", strip.edges, palette.PLAN)):
        shares = counts / max(int(counts.max()), 1)
        span = f"{counts[0]} → {counts[-1]}"
        page.html(f"<div>{name}, {span}:</div>{_curve(shares, colour)}")
    for dip in sorted(strip.dips, key=lambda dip: -dip.fall)[:_DIPS]:
        _dip(case, strip, dip, page)


def _curve(shares: Sequence[float] | np.ndarray, colour: Rgb8) -> str:
    rows = np.unique(np.linspace(0, len(shares) - 1, min(len(shares), _POINTS)).astype(np.intp))
    return curve([(float(row), float(shares[row])) for row in rows], colour=colour)


def _dip(case: Case, strip: LifelongStrip, dip: Dip, page: Page) -> None:
    """Say where success fell, and what happened to the map on the way down."""
    first, last = strip.queries[dip.peak], strip.queries[dip.low]
    ends = [
        page.jump(case.seconds(dip.before), f"query {first}"),
        page.jump(case.seconds(dip.after), f"query {last}"),
    ]
    within = slice(dip.peak + 1, dip.low + 1)
    counts = [int(column[within].sum()) for column in (strip.pruned, strip.edges_added, strip.nodes_added)]
    page.html(
        f"<div><b>Dip:</b> success fell by {100 * dip.fall:.0f} % from {ends[0]} to {ends[1]}; meanwhile "
        f"{counts[0]} edges went, {counts[1]} edges and {counts[2]} nodes came.</div>"
    )
    touched = _touched(case, dip)
    if touched:
        links = (f"{page.link(f'{s} → {t}', PointAt(s, t))} {escape(what)}" for (s, t), what in touched)
        page.html(f"<div>Edges it touched most: {', '.join(links)}.</div>")


def _touched(case: Case, dip: Dip) -> list[tuple[EdgeKey, str]]:
    """Return the edges that changed most often in a dip, and how each ended; pruned ones first."""
    timeline, counts, ends = case.timeline, Counter[EdgeKey](), dict[EdgeKey, str]()
    for change in timeline.changes_until(dip.after)[len(timeline.changes_until(dip.before)) :]:
        delta = change.delta
        match delta:
            case EdgePruned():
                edge, what = (delta.source, delta.target), "pruned"
            case BeliefUpdated():
                edge, what = (delta.source, delta.target), f"p {delta.belief.p:.2f}"
            case EdgeAdded():
                edge, what = (delta.edge.source, delta.edge.target), "new"
            case _:
                continue
        counts[edge] += 1
        ends[edge] = what
    ranked = sorted(counts, key=lambda edge: (ends[edge] != "pruned", -counts[edge]))
    return [(edge, ends[edge]) for edge in ranked[:_EDGES]]
