"""SGM (Emmons et al. 2020), "Sparse Graphical Memory", as the paper compares it, on the temporal distance of ViNG.

Owns its rules: an image merges with a node if both have similar distances to and from all neighbours of the node
(two-way consistency); each node keeps its five shortest edges; the cost of a path is its number of edges; an edge that
fails is deleted. In SGM, a step is that of a simulated point, and an edge is at most ten steps. Here a step is from one
image of a drive to the next, and ViNG's edges are at most eight steps, so all cutoffs are scaled by 8 / 10 (ours). SGM
merges images by a moving average of embeddings; here a node keeps its first image, because the robot must drive to it.
"""

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.planner import hop_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalDistanceRule
from ltvn_core.systems.all_image_map import (
    AllPairs,
    all_image_deltas,
    cheapest_from_each,
    encode_trajectory,
)
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
from ltvn_core.systems.temporal_distance import (
    EDGE_STEPS,
    NearestInTime,
    reachability_of_steps,
    temporal_distances,
    with_step_thresholds,
)
from ltvn_core.types import FrameId, Observation, Predictor

MERGE_STEPS = 2.0
"""Largest distance, in both directions, of an image from a node that it merges with (ours, for SGM's cutoff of
embeddings)."""
CONSISTENCY_STEPS = 5.0 * EDGE_STEPS / 10.0
"""Largest difference between the distances of an image and a node to a neighbour of the node, in steps."""
FAR_STEPS = 4 * EDGE_STEPS
"""Upper limit of distances in steps, because a learned distance saturates (ours)."""
NEAREST_COUNT = 5
"""Number of outgoing edges that a node keeps."""

Steps = NDArray[np.float64]
"""(N, N) temporal distances between images, from the row to the column, at most `FAR_STEPS`."""


def sgm_system(method: Method) -> NavigationSystem:
    """Return SGM; `method` has the thresholds of controller and success check, which are converted to steps."""
    scaled = with_step_thresholds(method)
    return NavigationSystem(
        name="sgm",
        method=scaled,
        build=partial(_build, method=scaled),
        edge_weight=hop_cost,
        localise=NearestInTime(),  # Localisation has no limit of distance.
        subgoal=choose_first_node,
        maintenance=DeleteOnFailure() if method.maintain else NoMaintenance(),
    )


class DeleteOnFailure(NoMaintenance):
    """Deletes an edge after its first failure, which SGM calls cleanup."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Prune the edge that failed."""
        if attempt.succeeded or (attempt.source, attempt.target) not in graph.edges:
            return ()
        return (EdgePruned(attempt.source, attempt.target, Cause.ATTEMPT),)


def _build(
    observations: Sequence[Observation],
    keyframes: KeyframeStore,
    predictor: Predictor,
    *,
    method: Method,
    rng: np.random.Generator,
    goals: Collection[FrameId] = (),
    progress: ProgressCallback | None = None,
) -> Deltas:
    """Return a sparse map in which `goals` never merge; `rng` is not used."""
    ordered, features = encode_trajectory(observations, keyframes, predictor, goals)
    pairs = AllPairs.predict(features, predictor, progress)
    reachability = pairs.reachability
    # If the robot may reverse, an edge back is as good as the edge.
    may_reverse = method.matching.both_directions
    surer = np.maximum(reachability, reachability.T) if may_reverse else reachability
    steps = np.minimum(temporal_distances(surer), FAR_STEPS)
    nodes = merge_consistent(steps, {k for k, seen in enumerate(ordered) if seen.step in goals})
    joined = []
    for a, b in nearest_edges(steps[np.ix_(nodes, nodes)]):
        source = nodes[a]
        target = nodes[b]
        link = pairs.link(source, target, reachability_of_steps(steps[source, target]), may_reverse=may_reverse)
        joined.append(link._replace(source=a, target=b))
    keyframes.keep_only([ordered[k].step for k in nodes])
    return tuple(all_image_deltas([ordered[k] for k in nodes], joined, method.believing))


def merge_consistent(steps: Steps, kept: Collection[int] = ()) -> list[int]:
    """Return which of N images become nodes, in order; the others merge with a node. Images in `kept` never merge."""
    nodes: list[int] = []
    for image in range(len(steps)):
        near = [node for node in nodes if max(steps[image, node], steps[node, image]) <= MERGE_STEPS]
        if image in kept or not any(_are_consistent(steps, image, node, nodes) for node in near):
            nodes.append(image)
    return nodes


def _are_consistent(steps: Steps, image: int, node: int, nodes: Sequence[int]) -> bool:
    """Return whether an image and a node have similar distances to and from all nodes that the node is joined with.

    A node without edges has no neighbours to compare, so no image merges with it.
    """
    others = np.array([other for other in nodes if other != node], np.intp)
    before = others[steps[others, node] < EDGE_STEPS]
    after = others[steps[node, others] < EDGE_STEPS]
    if not len(before) and not len(after):
        return False
    coming = np.abs(steps[before, image] - steps[before, node])
    going = np.abs(steps[image, after] - steps[node, after])
    return bool(np.concatenate([coming, going]).max() < CONSISTENCY_STEPS)


def nearest_edges(steps: Steps) -> list[tuple[int, int]]:
    """Return the edges between N nodes: from each node to its five nearest ones, if shorter than the cutoff."""
    return cheapest_from_each(steps, NEAREST_COUNT, below=EDGE_STEPS)


SGM = SystemEntry(
    name="sgm",
    label="SGM",
    factory=sgm_system,
    weights=shipped_weights("ving"),
    learning=TemporalLearning(TemporalDistanceRule(), even_distances=False),
)
