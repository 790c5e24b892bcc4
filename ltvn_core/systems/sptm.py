"""SPTM (Savinov et al. 2018) as the paper ran it: all images, consecutive ones joined, and the 2,000 best shortcuts.

Owns its rules for edges, localisation and subgoals, with the constants of its published configuration. The cost of a
path is its number of edges, and the map does not change while driving. The robot's pose estimator and controller are
the same as in all systems.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, LOCAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance
from ltvn_core.graph.planner import hop_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalClosenessRule
from ltvn_core.systems.all_image_map import (
    EdgeCandidate,
    all_image_deltas,
    consecutive_rows,
    encode_trajectory,
    predict_all_pairs,
)
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
from ltvn_core.types import Features, FrameId, NodeId, Observation, Predictor

MAX_SHORTCUTS = 2000
"""Largest number of shortcuts; the pairs with the highest scores become shortcuts."""
MIN_SHORTCUT_SCORE = 0.5
"""Least score of a shortcut (ours; matters only for short trajectories)."""
MIN_STEPS_APART = 5
"""Number of steps up to which images need no shortcut."""
MEDIAN_WINDOW = 10
"""Number of pairs before and after a pair in the median that is its score."""
MAX_NODES_AHEAD = 7
"""Largest number of nodes from the robot's node to the subgoal on the path."""
MIN_REACHABILITY, MIN_REACHABILITY_ON_PATH = 0.95, 0.7
"""Least r of a subgoal and of the node at which the robot is localised; the second value holds on the last path."""
NEAREST_COUNT = 5
"""Number of best nodes whose median in time gives the robot's node, if none on the last path is near enough."""


def sptm_system(method: Method) -> NavigationSystem:
    """Return SPTM; `method` has the thresholds of the controller and of the success check."""
    return NavigationSystem(
        name="sptm",
        method=method,
        build=partial(_build, method=method),
        edge_weight=hop_cost,
        localise=_localise,
        subgoal=choose_farthest_close_node,
        maintenance=NoMaintenance(),
    )


def choose_farthest_close_node(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the farthest of the next 7 nodes with r >= 0.95, the first if there is none."""
    ahead = range(min(MAX_NODES_AHEAD, len(path) - 1), 1, -1)
    return next((k for k in ahead if reachability(path[k]) >= MIN_REACHABILITY), 1)


def _localise(features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher) -> Localisation:
    """Find the best node at the beginning of the last path, else the median in time of the 5 best of all nodes."""
    ahead = [node for node in prior.plan[: MAX_NODES_AHEAD + 1] if node in graph.nodes and node not in prior.doubted]
    near = matcher.match(features, ahead)
    if len(near) and near.reachability.max() >= MIN_REACHABILITY_ON_PATH:
        return best_localisation(near, -near.reachability, near.reachability >= MIN_REACHABILITY_ON_PATH, LOCAL)
    matches = matcher.match(features, prior.candidates(graph))
    order = np.argsort(-matches.reachability, kind="stable")[:NEAREST_COUNT]
    close = [k for k in order if matches.reachability[k] >= MIN_REACHABILITY]
    passing = np.zeros(len(matches), bool)
    if close:
        passing[sorted(close, key=lambda k: matches.nodes[k])[len(close) // 2]] = True
    return best_localisation(matches, -matches.reachability, passing, GLOBAL)


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
    rows = [found.reachability.astype(np.float32) for found in predict_all_pairs(features, predictor, progress)]
    pairs = [*consecutive_rows(ordered, keyframes), *select_shortcuts(np.stack(rows))]
    return tuple(all_image_deltas(ordered, _both_ways(pairs, features, predictor), method.believing))


def select_shortcuts(reachability: NDArray[np.float32]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of N images with the highest scores that are far apart in time, the best first.

    The higher r of both directions in `reachability` (N, N) counts, because the edge back is driven in reverse. A true
    match remains one when both images advance together, so the score is a median along the diagonal.
    """
    both = np.maximum(reachability, reachability.T)
    lags = range(MIN_STEPS_APART + 1, len(both))
    if not lags:
        return
    scores = np.concatenate([median_filter(both.diagonal(lag), 2 * MEDIAN_WINDOW + 1, mode="reflect") for lag in lags])
    first = np.concatenate([np.arange(len(both) - lag) for lag in lags])
    second = first + np.repeat(lags, len(both) - np.array(lags))
    for k in np.argsort(-scores, kind="stable")[:MAX_SHORTCUTS]:
        if scores[k] >= MIN_SHORTCUT_SCORE:
            yield int(first[k]), int(second[k])


def _both_ways(pairs: Sequence[tuple[int, int]], features: Features, predictor: Predictor) -> Iterable[EdgeCandidate]:
    """Yield the links of each pair in both directions, with the waypoint of the direction that has the higher r."""
    if not pairs:
        return
    first, second = np.array(pairs).T
    ahead = predictor.predict(features[first], features[second])
    back = predictor.predict(features[second], features[first])
    for k, (a, b) in enumerate(pairs):
        surer = ahead.reachability[k] >= back.reachability[k]
        there = EdgeCandidate(a, b, ahead.reachability[k], ahead.waypoints[k])
        candidate = there if surer else EdgeCandidate(b, a, back.reachability[k], back.waypoints[k])
        yield candidate
        yield candidate.reversed()


SPTM = SystemEntry(
    name="sptm",
    label="SPTM",
    factory=sptm_system,
    weights=shipped_weights("sptm"),
    learning=TemporalLearning(TemporalClosenessRule()),
)
