"""SPTM (Savinov et al. 2018) as the paper ran it: all images, consecutive ones joined, and the 2,000 best shortcuts.

Owns its rules for edges, localisation and subgoals, with the numbers of its published configuration. Paths count hops,
and driving teaches nothing. The robot's pose estimator and controller are those of all systems.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ltvn_core.config import Method
from ltvn_core.graph.builder import Progress, check_trajectory
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.localizer import GLOBAL, LOCAL, Fix, Recall, best_fix
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.rivals.all_images import Link, each_with_all, nodes_and_edges, take_in
from ltvn_core.graph.system import Deltas, System, Untouched
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.types import Features, FrameId, NodeId, Observation, Predictor

SHORTCUTS = 2000
"""So many pairs of images become shortcuts, the closest ones."""
LEAST_SCORE = 0.5
"""A pair that seems rather far than close is no shortcut (ours; matters only for short trajectories)."""
MIN_APART = 5
"""Images no farther apart in time than this need no shortcut."""
WINDOW = 10
"""The score of a pair is the median over so many pairs before and after it."""
LOOK_AHEAD = 7
"""So many nodes ahead on the path may be the subgoal."""
CLOSE, WEAKLY_CLOSE = 0.95, 0.7
"""Least r of a subgoal and of the node the robot is at; the second holds on the last path."""
NEAREST = 5
"""Where the last path does not help, the robot is at the middle one in time of so many best nodes."""


def sptm(method: Method) -> System:
    """Return SPTM; `method` has the thresholds of the controller and of judging."""
    return System(
        name="sptm",
        method=method,
        build=partial(_build, method=method),
        edge_weight=_hop,
        localise=_localise,
        subgoal=farthest_close,
        maintenance=Untouched(),
    )


def farthest_close(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the farthest of the next 7 nodes with r >= 0.95, the first if there is none."""
    ahead = range(min(LOOK_AHEAD, len(path) - 1), 1, -1)
    return next((k for k in ahead if reachability(path[k]) >= CLOSE), 1)


def _hop(belief: Belief) -> float:
    return 1.0


def _localise(image: Features, graph: TopologicalGraph, recall: Recall, matcher: Matcher) -> Fix:
    """Find the best node at the beginning of the last path, else the middle one in time of the 5 best of all."""
    ahead = [node for node in recall.plan[: LOOK_AHEAD + 1] if node in graph.nodes and node not in recall.doubted]
    near = matcher.match(image, ahead)
    if len(near) and near.reachability.max() >= WEAKLY_CLOSE:
        return best_fix(near, -near.reachability, near.reachability >= WEAKLY_CLOSE, LOCAL)
    matches = matcher.match(image, recall.candidates(graph))
    order = np.argsort(-matches.reachability, kind="stable")[:NEAREST]
    close = [k for k in order if matches.reachability[k] >= CLOSE]
    passing = np.zeros(len(matches), bool)
    if close:
        passing[sorted(close, key=lambda k: matches.nodes[k])[len(close) // 2]] = True
    return best_fix(matches, -matches.reachability, passing, GLOBAL)


def _build(
    observations: Sequence[Observation],
    views: Views,
    predictor: Predictor,
    *,
    method: Method,
    rng: np.random.Generator,
    goals: Collection[FrameId] = (),
    progress: Progress | None = None,
) -> Deltas:
    """Return a map of all images; nothing is drawn with `rng`, and `goals` are nodes as every image is."""
    check_trajectory(observations, goals)
    ordered, features = take_in(observations, views)
    rows = [found.reachability.astype(np.float32) for found in each_with_all(features, predictor, progress)]
    pairs = [*itertools.pairwise(range(len(ordered))), *shortcuts(np.stack(rows))]
    return tuple(nodes_and_edges(ordered, _both_ways(pairs, features, predictor), method.believing))


def shortcuts(closeness: NDArray[np.float32]) -> Iterator[tuple[int, int]]:
    """Yield the closest pairs of N images that are far apart in time, the best first.

    `closeness` (N, N) is asked both ways, and the surer answer counts, because the way back is driven in reverse. A
    true match stays one while both images move on together, so the score is a median along the diagonal.
    """
    both = np.maximum(closeness, closeness.T)
    lags = range(MIN_APART + 1, len(both))
    if not lags:
        return
    scores = np.concatenate([median_filter(both.diagonal(lag), 2 * WINDOW + 1, mode="reflect") for lag in lags])
    first = np.concatenate([np.arange(len(both) - lag) for lag in lags])
    second = first + np.repeat(lags, len(both) - np.array(lags))
    for k in np.argsort(-scores, kind="stable")[:SHORTCUTS]:
        if scores[k] >= LEAST_SCORE:
            yield int(first[k]), int(second[k])


def _both_ways(pairs: Sequence[tuple[int, int]], features: Features, predictor: Predictor) -> Iterable[Link]:
    """Yield the links of each pair there and back, along the waypoint of which the network is surer."""
    if not pairs:
        return
    first, second = np.array(pairs).T
    ahead, back = (
        predictor.predict(features[first], features[second]),
        predictor.predict(features[second], features[first]),
    )
    for k, (a, b) in enumerate(pairs):
        surer = ahead.reachability[k] >= back.reachability[k]
        there = Link(a, b, ahead.reachability[k], ahead.waypoints[k])
        link = there if surer else Link(b, a, back.reachability[k], back.waypoints[k])
        yield link
        yield link.reversed()
