"""Metrics of lifelong evaluations: changes of the maps by queries, and the static test before and after.

`metrics` has the means over episodes and their intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ltvn_core.evaluation.metrics import compute_metrics
from ltvn_core.evaluation.results import LifelongResult, TrialResult


@dataclass(frozen=True, slots=True)
class StaticTestMetrics:
    """Metrics of the static test after a number of queries."""

    queries: int
    """Number of queries before it."""
    success_rate: float
    success_low: float
    """95 % interval."""
    success_high: float
    collisions_per_episode: float
    nodes: float
    """Mean over the maps, as are the edges."""
    edges: float
    spurious_share: float
    """Share of the edges that are spurious."""


@dataclass(frozen=True, slots=True)
class LifelongMetrics:
    """Changes of one or several maps by queries with maintenance."""

    before: StaticTestMetrics
    """The static test with the maps as they were built,"""
    after: StaticTestMetrics
    """and after all queries."""
    queries: int
    """With maintenance, in all maps together."""
    reached_share: float
    """Of these queries."""
    collisions_per_query: float
    pruned: int
    """Edges that left the maps."""
    pruned_bad_share: float | None
    """Share of them that are spurious or that the robot could not drive; None if none was pruned."""
    pruned_spurious: int
    """Number of them that are spurious by the ground truth."""
    added_nodes: int
    added_edges: int
    added_spurious: int
    """Added edges that are spurious."""


def lifelong_metrics(results: Sequence[LifelongResult]) -> LifelongMetrics:
    """Return the metrics of lifelong evaluations of equal length; raise ValueError if there are none."""
    queries = [query for result in results for query in result.queries]
    pruned = sum(query.pruned for query in queries)
    return LifelongMetrics(
        before=_static_test_metrics([result.points[0].trial for result in results]),
        after=_static_test_metrics([result.points[-1].trial for result in results]),
        queries=len(queries),
        reached_share=sum(query.reached for query in queries) / len(queries),
        collisions_per_query=sum(query.collisions for query in queries) / len(queries),
        pruned=pruned,
        pruned_bad_share=sum(query.pruned_bad for query in queries) / pruned if pruned else None,
        pruned_spurious=sum(query.pruned_spurious for query in queries),
        added_nodes=sum(query.added_nodes for query in queries),
        added_edges=sum(query.added_edges for query in queries),
        added_spurious=sum(query.added_spurious for query in queries),
    )


def _static_test_metrics(trials: Sequence[TrialResult]) -> StaticTestMetrics:
    found = compute_metrics(trials)
    return StaticTestMetrics(
        queries=trials[0].queries,
        success_rate=found.success_rate.mean,
        success_low=found.success_rate.low,
        success_high=found.success_rate.high,
        collisions_per_episode=found.collisions_per_episode.mean,
        nodes=found.nodes,
        edges=found.edges,
        spurious_share=found.spurious_share,
    )
