"""How well a system predicts which edges are open: squared error and calibration against the truth of the moment."""

from collections.abc import Collection, Sequence

import numpy as np

from ltvn_core.evaluation.query_result import PresenceBin, PresenceScore
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.network.metrics.binned_metrics import calibration_table

_BINS = 10


def score_presence(
    system: NavigationSystem,
    graph: TopologicalGraph,
    at_s: float,
    edges: Sequence[EdgeKey],
    closed: Collection[EdgeKey],
) -> PresenceScore:
    """Judge what a system predicts for `edges` at a moment, when `closed` of them are closed."""
    p = _predicted(system, graph, at_s, edges)
    closed = set(closed)
    is_open = np.array([edge not in closed for edge in edges], bool)
    cells = (
        PresenceBin(cell.pairs, cell.predicted or 0.0, cell.reachable or 0.0)
        for cell in calibration_table(p, is_open, _BINS)
    )
    return PresenceScore(len(edges), float(np.mean((p - is_open) ** 2)) if edges else 0.0, tuple(cells))


def _predicted(system: NavigationSystem, graph: TopologicalGraph, at_s: float, edges: Sequence[EdgeKey]) -> np.ndarray:
    """Return (N,) the probabilities; an edge that has left the map is held to be closed.

    Where a system has no notion of presence, what it believes of an edge says both; a static map says yes to all.
    """
    if system.presence is not None:
        known = system.presence.probabilities(graph, at_s)
        found = [known.get(edge, 1.0) if edge in graph.edges else 0.0 for edge in edges]
    elif isinstance(system.maintenance, NoMaintenance):
        found = [1.0] * len(edges)
    else:
        found = [graph.edges[edge].belief.p if edge in graph.edges else 0.0 for edge in edges]
    return np.array(found, np.float64)
