"""HTM (Liu et al. 2020), "Hallucinative Topological Memory", as far as a drive leaves it something to do.

Owns its rules: nodes are images, every one is joined with every other, and an edge weighs the inverse of the share that
a contrastive score gives to its target among all; the robot is at the image of the highest score, and drives to the
first node of the cheapest path. Driving teaches nothing.

Theirs are 300 images that a generative model draws for a place nobody has driven through. Here the robot has driven,
so the images of its drive take their place, and nothing is hallucinated. Their score is a product of two embeddings,
ours a last layer on the shipped network; both learn by contrastive prediction against 50 negatives, theirs of one step
ahead, ours of five, since an image here is only 0.12 m or 10 degrees from the last. In a complete graph an edge to a
place that cannot be seen is so dear that no path takes it, so each node keeps its fifty cheapest (ours).
"""

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Method
from ltvn_core.graph.builder import ProgressCallback
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
"""A node keeps so many edges that lead from it, the cheapest ones."""
_LEAST_REACHABILITY = 1e-6
_LEAST_SHARE = 1e-9


def htm_system(method: Method) -> NavigationSystem:
    """Return HTM; `method` has the thresholds of the controller and of judging."""
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
    """Return what an edge weighs: the inverse of the share that its source's scores give to its target."""
    return 1.0 / max(belief.p, _LEAST_SHARE)


def shares(reachability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, N): the softmax over each row of the scores whose logistic function is r (N, N).

    The inverse of a share is their weight, the sum over k of exp(score of k - score of this one).
    """
    r = np.clip(reachability, _LEAST_REACHABILITY, 1 - _LEAST_REACHABILITY)
    odds = r / (1 - r)
    return odds / odds.sum(axis=1, keepdims=True)


def _localise(features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher) -> Localisation:
    """Find the node of the highest score, however low."""
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
    """Return a map of all images; nothing is drawn with `rng`, and `goals` are nodes as every image is."""
    ordered, features = encode_trajectory(observations, keyframes, predictor, goals)
    pairs = AllPairs.predict(features, predictor, progress)
    may_reverse = method.matching.both_directions
    reachability = pairs.reachability
    share = shares(np.maximum(reachability, reachability.T) if may_reverse else reachability)
    links = (pairs.link(a, b, float(share[a, b]), may_reverse=may_reverse) for a, b in cheapest_edges(share))
    return tuple(all_image_deltas(ordered, links, method.believing))


def cheapest_edges(share: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return of each of N nodes the edges to the nodes with the largest shares (N, N), itself left out."""
    return cheapest_from_each(-share, EDGES_PER_NODE)


HTM = SystemEntry(
    name="htm",
    label="HTM",
    factory=htm_system,
    weights=shipped_weights("htm"),
    learning=TemporalLearning(TemporalClosenessRule(), even_distances=False, added=ContrastiveArchitecture()),
)
