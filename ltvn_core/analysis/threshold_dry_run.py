"""Counts the nodes and edges that another threshold would add to or remove from a map, without changing the map.

Owns the counts and their sentences. Everything runs on copies.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from ltvn_core.analysis.what_if_scenario import prunable_edges
from ltvn_core.config import PAPER, BeliefConfig, Method
from ltvn_core.graph.builder import build
from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.terminal_text import count_text
from ltvn_core.types import Observation, Predictor


@dataclass(frozen=True, slots=True)
class MapSize:
    """Number of nodes, edges and strongly connected components of a map."""

    nodes: int
    edges: int
    strongly_connected_components: int
    """Number of strongly connected components; 1 if every node can be reached from every other."""

    @classmethod
    def of(cls, graph: TopologicalGraph) -> "MapSize":
        """Measure a map; linear in nodes and edges."""
        return cls(
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            strongly_connected_components=count_strongly_connected_components(graph),
        )


@dataclass(frozen=True, slots=True)
class PruneCounts:
    """The effect of pruning all edges below a threshold at once."""

    pruned_edges: tuple[EdgeKey, ...]
    before: MapSize
    after: MapSize

    @property
    def sentence(self) -> str:
        """The effect as a sentence."""
        if not self.pruned_edges:
            return "No edge would go."
        return f"{count_text(len(self.pruned_edges), 'edge')} would go, {_components_text(self.before, self.after)}."


@dataclass(frozen=True, slots=True)
class RebuildCounts:
    """Sizes of two maps from the same images, built with two methods."""

    before: MapSize
    after: MapSize

    @property
    def sentence(self) -> str:
        """The count for a person, such as "31 nodes fewer, 120 edges fewer, 2 pieces instead of 1."."""
        nodes = _difference_text(self.after.nodes - self.before.nodes, "node")
        edges = _difference_text(self.after.edges - self.before.edges, "edge")
        return f"{nodes}, {edges}, {_components_text(self.before, self.after)}."


def prune_dry_run(graph: TopologicalGraph, prune_below: float, config: BeliefConfig = PAPER.believing) -> PruneCounts:
    """Return the edges that would be pruned with a higher R_p, and the size of the map afterwards.

    Only edges that failed as often as `config` requires are pruned, as in maintenance. Protected edges stay. Costs one
    copy of the map.
    """
    pruned_edges = prunable_edges(graph, prune_below, config)
    after = graph.copy()
    for source, target in pruned_edges:
        after.apply(EdgePruned(source, target, Cause.HAND))
    return PruneCounts(pruned_edges=tuple(pruned_edges), before=MapSize.of(graph), after=MapSize.of(after))


def rebuild_dry_run(
    observations: Sequence[Observation],
    keyframes: KeyframeStore,
    predictor: Predictor,
    method: Method,
    changed: Method,
    rng: np.random.Generator,
) -> RebuildCounts:
    """Build a map from the same images with both methods and the same random numbers, and return both sizes.

    Features in `keyframes` are reused, other images are encoded once; `keyframes` and `rng` stay unchanged. Costs two
    runs of Algorithm 1. Raises MapError for an empty trajectory.
    """
    sizes = []
    known = _encoded(observations, keyframes, predictor)
    for each in (method, changed):
        own = KeyframeStore(predictor)
        own.begin_drives(keyframes.drive_starts, resumed=keyframes.resumed_starts)
        own.space = keyframes.space
        if observations:
            own.add(observations, known.features([seen.step for seen in observations]))
        deltas = build(observations, own, predictor, each, deepcopy(rng))
        sizes.append(MapSize.of(TopologicalGraph(deltas)))
    before, after = sizes
    return RebuildCounts(before=before, after=after)


def _encoded(observations: Sequence[Observation], keyframes: KeyframeStore, predictor: Predictor) -> KeyframeStore:
    """Return a separate store of all images, with the features that `keyframes` holds."""
    known = KeyframeStore(predictor)
    held = [seen for seen in observations if seen.step in keyframes]
    if held:
        known.add(held, keyframes.features([seen.step for seen in held]))
    known.add(observations)
    return known


def _difference_text(count: int, noun: str) -> str:
    if not count:
        return f"as many {noun}s"
    return f"{count_text(abs(count), noun)} {'fewer' if count < 0 else 'more'}"


def _components_text(before: MapSize, after: MapSize) -> str:
    return count_text(after.strongly_connected_components, "piece") + (
        ""
        if after.strongly_connected_components == before.strongly_connected_components
        else f" instead of {before.strongly_connected_components}"
    )
