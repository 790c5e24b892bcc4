"""Temporal closeness: whether two images were taken soon after each other; and the rivals that drive by it.

**SPTM** (Savinov et al. 2018) as the paper ran it: all images, consecutive ones joined, and the 2,000 best shortcuts,
with the constants of its published configuration. The cost of a path is its number of edges.

**HTM** (Liu et al. 2020), "Hallucinative Topological Memory", on the images of a drive: nodes are images in a complete
graph. The cost of an edge is the inverse of its target's softmax share of a contrastive score. The robot is localised
at the image with the highest score, and drives to the first node of the cheapest path. In HTM, nodes are 300 images
that a generative model creates for an unseen place. Here the images of the robot's drive replace them, so nothing is
hallucinated. HTM's score is a product of two embeddings; ours is an output layer on the default network. Both are
trained by contrastive prediction against 50 negatives: HTM's one step ahead, ours up to five, because consecutive
images here are only 0.12 m or 10 degrees apart. In a complete graph, an edge to a place out of sight is so expensive
that no path uses it, so each node keeps only its 50 cheapest edges (ours).

The map does not change while driving. The robot's pose estimator and controller are the same as in all systems.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.rival import DriveImages, EdgeCandidate, cheapest_from_each, on_last_path
from ltvn_core.types import Features, NodeId

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
EDGES_PER_NODE = 50
"""Number of outgoing edges that a node keeps, the cheapest ones."""
_LEAST_REACHABILITY = 1e-6
_LEAST_SHARE = 1e-9


def keep_shortcuts(drive: DriveImages) -> tuple[Sequence[int], Iterator[EdgeCandidate]]:
    """Keep all images; join consecutive ones and the pairs with the highest scores (SPTM)."""
    rows = [found.reachability.astype(np.float32) for found in drive.predictions()]
    pairs = [*drive.consecutive(), *select_shortcuts(np.stack(rows))]
    return drive.rows, _both_ways(pairs, drive)


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


def _both_ways(pairs: Sequence[tuple[int, int]], drive: DriveImages) -> Iterator[EdgeCandidate]:
    """Yield the links of each pair in both directions, with the waypoint of the direction that has the higher r."""
    if not pairs:
        return
    first, second = (drive.features[rows] for rows in np.array(pairs).T)
    ahead = drive.predictor.predict(first, second)
    back = drive.predictor.predict(second, first)
    for k, (a, b) in enumerate(pairs):
        surer = ahead.reachability[k] >= back.reachability[k]
        there = EdgeCandidate(a, b, ahead.reachability[k], ahead.waypoints[k])
        link = there if surer else EdgeCandidate(b, a, back.reachability[k], back.waypoints[k])
        yield link
        yield link.reversed()


def choose_farthest_close_node(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the farthest of the next 7 nodes with r >= 0.95, the first if there is none."""
    ahead = range(min(MAX_NODES_AHEAD, len(path) - 1), 1, -1)
    return next((k for k in ahead if reachability(path[k]) >= MIN_REACHABILITY), 1)


def localise_near_path(
    features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
) -> Localisation:
    """Find the best node at the beginning of the last path, else the median in time of the 5 best of all nodes."""
    if found := on_last_path(features, graph, prior, matcher, MIN_REACHABILITY_ON_PATH, ahead=MAX_NODES_AHEAD + 1):
        return found
    matches = matcher.match(features, prior.candidates(graph))
    order = np.argsort(-matches.reachability, kind="stable")[:NEAREST_COUNT]
    close = [k for k in order if matches.reachability[k] >= MIN_REACHABILITY]
    passing = np.zeros(len(matches), bool)
    if close:
        passing[sorted(close, key=lambda k: matches.nodes[k])[len(close) // 2]] = True
    return best_localisation(matches, -matches.reachability, passing, GLOBAL)


def keep_cheapest_edges(drive: DriveImages) -> tuple[Sequence[int], list[EdgeCandidate]]:
    """Keep all images, and of the complete graph the cheapest edges of each (HTM)."""
    pairs = drive.all_pairs()
    share = shares(pairs.surer)
    return drive.rows, [pairs.link(a, b, float(share[a, b])) for a, b in cheapest_edges(share)]


def cheapest_edges(share: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return, for each of N nodes, the edges to the other nodes with the largest shares (N, N)."""
    return cheapest_from_each(-share, EDGES_PER_NODE)


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
