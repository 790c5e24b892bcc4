"""What another threshold would do to the map, counted and not done.

Owns the counts and their sentences. Everything runs on copies.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from ltvn_core.analysis.imagined import hopeless
from ltvn_core.config import PAPER, Believing, Method
from ltvn_core.graph.builder import Progress, build
from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.graph.planner import count_pieces
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.types import Observation, Predictor


@dataclass(frozen=True, slots=True)
class MapSize:
    """How big a map is."""

    nodes: int
    edges: int
    pieces: int
    """Parts between which no path leads there and back; 1 is what one wants."""

    @classmethod
    def of(cls, graph: TopologicalGraph) -> "MapSize":
        """Measure a map; linear in nodes and edges."""
        return cls(len(graph.nodes), len(graph.edges), count_pieces(graph))


@dataclass(frozen=True, slots=True)
class PruneCounts:
    """What pruning everything below a threshold at once would do."""

    gone: tuple[EdgeKey, ...]
    before: MapSize
    after: MapSize

    @property
    def sentence(self) -> str:
        """The count for a person."""
        if not self.gone:
            return "No edge would go."
        return f"{_counted(len(self.gone), 'edge')} would go, {_pieces(self.before, self.after)}."


@dataclass(frozen=True, slots=True)
class RebuildCounts:
    """What the same images make with two methods."""

    before: MapSize
    after: MapSize

    @property
    def sentence(self) -> str:
        """The count for a person, such as "31 nodes fewer, 120 edges fewer, 2 pieces instead of 1."."""
        nodes = _difference(self.after.nodes - self.before.nodes, "node")
        edges = _difference(self.after.edges - self.before.edges, "edge")
        return f"{nodes}, {edges}, {_pieces(self.before, self.after)}."


def prune_dry_run(graph: TopologicalGraph, prune_below: float, config: Believing = PAPER.believing) -> PruneCounts:
    """Return which edges a higher R_p would take out, and the pieces afterwards.

    Only edges that failed as often as `config` asks for count, as in maintenance. Protected edges stay. Costs one copy
    of the map.
    """
    gone = hopeless(graph, prune_below, config)
    after = graph.copy()
    for source, target in gone:
        after.apply(EdgePruned(source, target, Cause.HAND))
    return PruneCounts(tuple(gone), MapSize.of(graph), MapSize.of(after))


def rebuild_dry_run(
    observations: Sequence[Observation],
    views: Views,
    predictor: Predictor,
    method: Method,
    changed: Method,
    rng: np.random.Generator,
    *,
    progress: Progress | None = None,
) -> RebuildCounts:
    """Build a map from the same images with both methods and the same dice, and return both sizes.

    Features that `views` holds are used again, other images are encoded once; `views` and `rng` stay as they are. Costs
    two runs of Algorithm 1. Raises MapError for an empty trajectory.
    """
    sizes = []
    known = _encoded(observations, views, predictor)
    for each in (method, changed):
        own = Views(predictor)
        if observations:
            own.add(observations, known.features([seen.step for seen in observations]))
        deltas = build(observations, own, predictor, each, deepcopy(rng), progress=progress)
        sizes.append(MapSize.of(TopologicalGraph(deltas)))
    return RebuildCounts(*sizes)


def _encoded(observations: Sequence[Observation], views: Views, predictor: Predictor) -> Views:
    """Return views of all images that share nothing with `views` but the numbers."""
    known = Views(predictor)
    held = [seen for seen in observations if seen.step in views]
    if held:
        known.add(held, views.features([seen.step for seen in held]))
    known.add(observations)
    return known


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _difference(count: int, noun: str) -> str:
    if not count:
        return f"as many {noun}s"
    return f"{_counted(abs(count), noun)} {'fewer' if count < 0 else 'more'}"


def _pieces(before: MapSize, after: MapSize) -> str:
    return _counted(after.pieces, "piece") + ("" if after.pieces == before.pieces else f" instead of {before.pieces}")
