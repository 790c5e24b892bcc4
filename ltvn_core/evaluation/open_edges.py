"""Which edges of a map are open now, as the simulated world knows it: for the maintenance `truth`, and to judge."""

from collections.abc import Callable

import numpy as np

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.presence.edge_presence import KnownPresence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.oracle_predictor import MIN_CLEARANCE_M, is_line_free
from ltvn_core.types import FrameId, Observation


def closed_edges(world: World, graph: TopologicalGraph, truth: GroundTruth) -> set[EdgeKey]:
    """Return the edges whose straight ways are blocked now and are not in the scene as it was made.

    Raises MapError for a map whose images have no exact poses.
    """
    keys = list(graph.edges)
    if not keys or world.scene.clearance is world.base.clearance:
        return set()
    sources, targets = (truth.poses(ends) for ends in zip(*keys, strict=True))
    before, now = (
        is_line_free(clearance, sources, targets, MIN_CLEARANCE_M)
        for clearance in (world.base.clearance, world.scene.clearance)
    )
    return {keys[k] for k in np.flatnonzero(before & ~now)}


def true_presence(world: World, observation: Callable[[FrameId], Observation]) -> KnownPresence:
    """Return what tells which edges of a map are open; `observation` returns the images of its nodes."""
    truth = GroundTruth(world.base.clearance, observation)
    return KnownPresence(lambda graph: closed_edges(world, graph, truth))
