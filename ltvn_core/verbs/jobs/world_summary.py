"""The summary of `ltvn lifelong --world`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.evaluation.worlds.world_results import WorldResult


@dataclass(frozen=True)
class WorldSummary:
    """What the queries in a changing world came to; the numbers are those of the first maintenance."""

    world: str
    days: float
    scenes: tuple[str, ...]
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    maintenance: str
    """The first that was asked for."""
    queries: int
    success_rate: float
    success_low: float
    """95 % interval."""
    success_high: float
    spl: float
    """Against the shortest way of the moment."""
    blocked_tries_per_100: float
    """Attempts along closed edges in 100 queries,"""
    door_tries_per_100: float
    """and those of them through closed doors."""
    reopened_after_queries: float | None
    """Queries until a reopened door is used by one that wants it."""
    brier: float
    """Mean squared error of predicted presence when queries begin."""
    lost_edges_share: float
    nodes: float
    edges: float
    collisions_per_episode: float
    by_maintenance: dict[str, WorldMetrics]
    """All numbers of each maintenance."""
    folder: Path
    wall_s: float

    @classmethod
    def of(
        cls, results: Sequence[WorldResult], *, seeds: tuple[int, ...], folder: Path, wall_s: float
    ) -> "WorldSummary":
        """Sum up results of one world."""
        names = dict.fromkeys(result.maintenance for result in results)
        found = {name: world_metrics([each for each in results if each.maintenance == name]) for name in names}
        first, metrics = results[0], found[results[0].maintenance]
        return cls(
            world=first.world,
            days=first.days,
            scenes=tuple(dict.fromkeys(result.scene for result in results)),
            preset=first.preset,
            without=first.without,
            seeds=seeds,
            maintenance=first.maintenance,
            queries=metrics.queries,
            success_rate=metrics.success_rate,
            success_low=metrics.success_low,
            success_high=metrics.success_high,
            spl=metrics.spl,
            blocked_tries_per_100=metrics.blocked_tries_per_100,
            door_tries_per_100=metrics.door_tries_per_100,
            reopened_after_queries=metrics.reopened_after_queries,
            brier=metrics.brier,
            lost_edges_share=metrics.lost_edges_share,
            nodes=metrics.nodes,
            edges=metrics.edges,
            collisions_per_episode=metrics.collisions_per_episode,
            by_maintenance=found,
            folder=folder,
            wall_s=wall_s,
        )
