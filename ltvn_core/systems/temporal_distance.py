"""Temporal distance: r = exp(-steps / TAU), where a step is from one image of a drive to the next; and its rivals.

Owns this scale, localisation by temporal distance, the navigator's thresholds in steps, and the rules of the systems
that drive by it. Their networks are described in `docs/method.md`; each system's pose estimator and controller are
ours.

**ViNG** (Shah et al. 2021) keeps all images and joins those at most `EDGE_STEPS` apart. If the method compares both
directions, an edge can also be the edge of the other direction, driven in reverse.

**SGM** (Emmons et al. 2020), "Sparse Graphical Memory", works on the temporal distance of ViNG. An image merges with a
node if both have similar distances to and from all neighbours of the node (two-way consistency); each node keeps its
five shortest edges; the cost of a path is its number of edges; an edge that fails is deleted. In SGM, a step is that of
a simulated point, and an edge is at most ten steps. Here ViNG's edges are at most eight steps, so all cutoffs are
scaled by 8 / 10 (ours). SGM merges images by a moving average of embeddings; here a node keeps its first image, because
the robot must drive to it.

**SoRB** (Eysenbach et al. 2019), "Search on the Replay Buffer": at most a thousand images are nodes, joined where an
ensemble predicts that they are near. The largest distance of the members decides, because a single error of one network
would make a shortcut through a wall. The robot drives to the first node of the shortest path, or to the goal itself if
it is as near. SoRB has three critics, each a distribution over steps (C51) trained by reinforcement learning. Ours are
three stacks of output layers on the default network, trained on the steps of random walks like ViNG, each on a third of
the pairs. Their distances are bounded like a distribution over bins. Only these layers are fine-tuned on the robot's
drive. The ensemble is calibrated as a whole, so it differs from a single network only where its members disagree.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.config import Method
from ltvn_core.graph.deltas import Belief, Cause, EdgePruned
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation, doubt
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NoMaintenance
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.training_data.temporal_rules import TAU_STEPS
from ltvn_core.systems.rival import DriveImages, EdgeCandidate, cheapest_from_each, has_no_waypoint, surest_links
from ltvn_core.types import Features, NodeId, Prediction

EDGE_STEPS = 8.0
"""Largest predicted temporal distance of an edge in ViNG, in steps; other systems scale their limits by it."""
MERGE_STEPS = 2.0
"""Largest distance, in both directions, of an image from a node that it merges with (ours, for SGM's cutoff of
embeddings)."""
CONSISTENCY_STEPS = 5.0 * EDGE_STEPS / 10.0
"""Largest difference between the distances of an image and a node to a neighbour of the node, in steps."""
FAR_STEPS = 4 * EDGE_STEPS
"""Upper limit of distances in steps, because a learned distance saturates (ours)."""
NEAREST_COUNT = 5
"""Number of outgoing edges that a node keeps."""
MAX_STEPS = 6.0 * EDGE_STEPS / 10.0
"""MAXDIST: largest predicted distance of joined pairs, and of the node at which the robot is localised. SoRB's value is
6 steps of a simulated point, for which SGM's edges are at most ten steps; it is scaled like SGM's cutoffs (ours)."""
BUFFER_SIZE = 1000
"""Largest number of images drawn as nodes, the size of the replay buffer in SoRB. Goals are always nodes."""

Steps = NDArray[np.float64]
"""(N, N) temporal distances between images, from the row to the column, at most `FAR_STEPS`."""


def reachability_of_steps(steps: float) -> float:
    """Return r of a temporal distance in steps."""
    return math.exp(-steps / TAU_STEPS)


def temporal_distances(reachability: ArrayLike) -> NDArray[np.float64]:
    """Return the temporal distances in steps for r of any shape."""
    return TAU_STEPS * doubt(reachability)


def temporal_cost(belief: Belief) -> float:
    """Return the length of an edge in steps, at least one."""
    # Labels are at least one step; without this limit an overconfident network would make detours free.
    return max(1.0, float(temporal_distances(belief.p)))


@dataclass(frozen=True, slots=True)
class NearestInTime:
    """Localisation at the node with the least temporal distance, if it is near enough."""

    within_steps: float = math.inf

    def __call__(
        self, features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
    ) -> Localisation:
        """Return that node; doubted nodes are left out."""
        matches = matcher.match(features, prior.candidates(graph))
        steps = temporal_distances(matches.reachability)
        near = (steps <= self.within_steps) & np.isfinite(matches.distances)
        return best_localisation(matches, steps, near, GLOBAL)


def with_step_thresholds(method: Method) -> Method:
    """Return the method with thresholds of the navigator that fit r of temporal distances."""
    edge = reachability_of_steps(EDGE_STEPS)
    driving = replace(
        method.driving,
        departure_reachability=edge if method.driving.departure_reachability else 0.0,
        lost_reachability=reachability_of_steps(2 * EDGE_STEPS),
    )
    judging = replace(
        method.judging, success_reachability=edge, arrive_reachability=reachability_of_steps(EDGE_STEPS / 2)
    )
    # A failure should count as much for edges of several steps as it does for edges of a metre.
    penalty = method.planning.failure_penalty * EDGE_STEPS
    return replace(
        method,
        driving=driving,
        judging=judging,
        planning=replace(method.planning, failure_penalty=penalty),
        building=replace(method.building, connect_reachability=edge),
    )


def keep_near_images(drive: DriveImages) -> tuple[Sequence[int], list[EdgeCandidate]]:
    """Keep all images, join those that are predicted near, and each with the next image of its drive, one step away
    (ViNG)."""
    followed = {row for row, _ in drive.consecutive()}

    def close() -> Iterator[EdgeCandidate]:
        for k, found in enumerate(drive.predictions()):
            following = [k + 1] if k in followed else []
            yield from _near(found, EDGE_STEPS, drive.rows, k, but=[k, *following])
            for after in following:
                onward = drive.predictor.predict(drive.features[k : k + 1], drive.features[after : after + 1])
                yield EdgeCandidate(k, after, reachability_of_steps(1.0), onward.waypoints[0])

    return drive.rows, surest_links(close(), both_directions=drive.may_reverse)


def keep_buffer(drive: DriveImages) -> tuple[Sequence[int], list[EdgeCandidate]]:
    """Keep images drawn at random, and all goals; join those that are predicted within MAXDIST (SoRB)."""
    kept = sorted({*drive.rng.permutation(len(drive.rows))[:BUFFER_SIZE].tolist(), *drive.goals})
    found = enumerate(drive.predictions(kept))
    near = (link for k, each in found for link in _near(each, MAX_STEPS, kept, k, but=[k]))
    return kept, surest_links(near, both_directions=drive.may_reverse)


def _near(
    found: Prediction, within_steps: float, rows: Sequence[int], source: int, *, but: list[int]
) -> Iterator[EdgeCandidate]:
    """Yield the links from a source to the rows that are predicted near it; source and `but` are places in `rows`."""
    near = (found.reachability >= reachability_of_steps(within_steps)) & ~has_no_waypoint(found.waypoints)
    near[but] = False
    for k in np.flatnonzero(near).tolist():
        yield EdgeCandidate(rows[source], rows[k], found.reachability[k], found.waypoints[k])


def choose_goal_if_nearer(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the goal itself if it is predicted within MAXDIST and not farther than the first node; otherwise the first
    node."""
    goal = reachability(path[-1])
    nearer = goal >= reachability_of_steps(MAX_STEPS) and goal >= reachability(path[1])
    return len(path) - 1 if nearer else 1


def keep_consistent_images(drive: DriveImages) -> tuple[Sequence[int], list[EdgeCandidate]]:
    """Merge images that see their neighbours alike, except goals, and keep the shortest edges (SGM)."""
    pairs = drive.all_pairs()
    steps = np.minimum(temporal_distances(pairs.surer), FAR_STEPS)
    nodes = merge_consistent(steps, drive.goals)
    ends = ((nodes[a], nodes[b]) for a, b in nearest_edges(steps[np.ix_(nodes, nodes)]))
    return nodes, [pairs.link(*pair, reachability_of_steps(steps[pair])) for pair in ends]


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


class DeleteOnFailure(NoMaintenance):
    """Deletes an edge after its first failure, which SGM calls cleanup."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Prune the edge that failed."""
        if attempt.succeeded or (attempt.source, attempt.target) not in graph.edges:
            return ()
        return (EdgePruned(attempt.source, attempt.target, Cause.ATTEMPT),)
