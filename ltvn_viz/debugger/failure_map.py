"""Faults of the map in which a query failed: edges that odometry contradicts, and the gap before the goal.

Owns this part of the answer to “What failed?”. `ltvn_core.analysis.map_faults` finds the faults.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ltvn_core.analysis.failure_triage import FailedQuery
from ltvn_core.analysis.map_faults import ContradictedEdge, MapGap, contradicted_edges, map_gap
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Outcome
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, edge_link

_ROWS = 6


@dataclass(frozen=True, slots=True)
class MapFaults:
    """The faults found in a map."""

    contradicted: tuple[ContradictedEdge, ...]
    gap: MapGap | None
    """Gap in the map; None unless the query failed because there was no path."""


def add_map_faults(context: DebugContext, failure: FailedQuery, builder: AnswerBuilder) -> None:
    """Report suspicious parts of the map at the beginning of the query; nothing if there are none."""
    graph = context.timeline.graph_before(failure.query.first)
    question = "map faults", context.name, context.start_s, failure.query.first, failure.query.last
    faults: MapFaults | None = context.in_background(question, _search(graph, failure))
    if faults is None:
        builder.add_pending("Searching the map")
        return
    _contradicted(faults.contradicted, builder)
    if faults.gap is not None:
        _gap(faults.gap, builder)


def _search(graph: TopologicalGraph, failure: FailedQuery) -> Callable[[], MapFaults]:
    is_without_way = failure.query.outcome is Outcome.NO_PATH
    start: NodeId | None = failure.node if is_without_way else None

    def search() -> MapFaults:
        """Search for the faults; runs in the worker's thread."""
        gap = None if start is None else map_gap(graph, start, failure.query.goal)
        return MapFaults(contradicted=contradicted_edges(graph), gap=gap)

    return search


def _contradicted(found: Sequence[ContradictedEdge], builder: AnswerBuilder) -> None:
    if not found:
        return
    builder.add_line("Odometry contradicts edges of the first map: their ends may be two places that look alike.")
    rows = [(edge_link(*each.edge), f"{each.length_m:.2f}", f"{each.odometry_m:.2f}") for each in found[:_ROWS]]
    builder.add_table(("contradicted edge", "length, m", "by odometry, m"), rows)


def _gap(gap: MapGap, builder: AnswerBuilder) -> None:
    builder.add_line(
        f"The first map has a gap: paths lead from node {gap.start} to {gap.reached} nodes, and from {gap.leading} "
        f"other nodes to node {gap.goal}."
    )
    rows = [(edge_link(*pair.edge), f"{pair.distance:.2f}") for pair in gap.nearest]
    if rows:
        builder.add_table(("nearest across the gap", "d by odometry"), rows)
