"""HTM (Liu et al. 2020), "Hallucinative Topological Memory", on the images of a drive.

Owns its rules: nodes are images in a complete graph. The cost of an edge is the inverse of its target's softmax share
of a contrastive score. The robot is localised at the image with the highest score, and drives to the first node of the
cheapest path. The map does not change while driving.

In HTM, nodes are 300 images that a generative model creates for an unseen place. Here the images of the robot's drive
replace them, so nothing is hallucinated. HTM's score is a product of two embeddings; ours is an output layer on the
default network. Both are trained by contrastive prediction against 50 negatives: HTM's one step ahead, ours up to five,
because consecutive images here are only 0.12 m or 10 degrees apart. In a complete graph, an edge to a place out of
sight is so expensive that no path uses it, so each node keeps only its 50 cheapest edges (ours).
"""

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.architecture import ContrastiveArchitecture
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalClosenessRule
from ltvn_core.systems.all_image_map import (
    AllPairs,
    all_image_deltas,
    cheapest_from_each,
    encode_trajectory,
)
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
from ltvn_core.types import Features, FrameId, Observation, Predictor

EDGES_PER_NODE = 50
"""Number of outgoing edges that a node keeps, the cheapest ones."""
_LEAST_REACHABILITY = 1e-6
_LEAST_SHARE = 1e-9


def htm_system(method: Method) -> NavigationSystem:
    """Return HTM; `method` has the thresholds of the controller and of the success check."""
    return NavigationSystem(
        name="htm",
        method=method,
        build=partial(_build, method=method),
        edge_weight=inverse_share,
        localise=_localise,
        subgoal=choose_first_node,
        maintenance=NoMaintenance(),
    )


def inverse_share(belief: Belief) -> float:
    """Return the cost of an edge: the inverse of its target's share of the source's scores."""
    return 1.0 / max(belief.p, _LEAST_SHARE)


def shares(reachability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the softmax (N, N) over each row of scores, which are the logits of r (N, N).

    The inverse of a share is HTM's edge weight, the sum over k of exp(score of k - score of this one).
    """
    r = np.clip(reachability, _LEAST_REACHABILITY, 1 - _LEAST_REACHABILITY)
    odds = r / (1 - r)
    return odds / odds.sum(axis=1, keepdims=True)


def _localise(features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher) -> Localisation:
    """Find the node with the highest score, without a threshold."""
    matches = matcher.match(features, prior.candidates(graph))
    return best_localisation(matches, -matches.reachability, np.isfinite(matches.distances), GLOBAL)


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
    """Return a map of all images, including `goals`; `rng` is not used."""
    ordered, features = encode_trajectory(observations, keyframes, predictor, goals)
    pairs = AllPairs.predict(features, predictor, progress)
    may_reverse = method.matching.both_directions
    reachability = pairs.reachability
    share = shares(np.maximum(reachability, reachability.T) if may_reverse else reachability)
    links = (pairs.link(a, b, float(share[a, b]), may_reverse=may_reverse) for a, b in cheapest_edges(share))
    return tuple(all_image_deltas(ordered, links, method.believing))


def cheapest_edges(share: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return, for each of N nodes, the edges to the other nodes with the largest shares (N, N)."""
    return cheapest_from_each(-share, EDGES_PER_NODE)


HTM = SystemEntry(
    name="htm",
    label="HTM",
    factory=htm_system,
    weights=shipped_weights("htm"),
    learning=TemporalLearning(TemporalClosenessRule(), even_distances=False, added=ContrastiveArchitecture()),
)
