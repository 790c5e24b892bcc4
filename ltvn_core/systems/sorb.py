"""SoRB (Eysenbach et al. 2019), "Search on the Replay Buffer", as the paper compares it, on predicted steps.

Owns its rules: at most a thousand images are nodes, joined where an ensemble predicts that they are near. The largest
distance of the members decides, because a single error of one network would make a shortcut through a wall. The robot
drives to the first node of the shortest path, or to the goal itself if it is as near. The map does not change while
driving.

SoRB has three critics, each a distribution over steps (C51) trained by reinforcement learning. Ours are three stacks of
output layers on the default network, trained on the steps of random walks like ViNG, each on a third of the pairs.
Their distances are bounded like a distribution over bins, and the pose estimator is the same as in all systems. Only
these layers are fine-tuned on the robot's drive. The ensemble is calibrated as a whole, so it differs from a single
network only where its members disagree.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance
from ltvn_core.network.architecture import EnsembleArchitecture
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalDistanceRule
from ltvn_core.systems.all_image_map import (
    EdgeCandidate,
    all_image_deltas,
    encode_trajectory,
    has_no_waypoint,
    predict_all_pairs,
    surest_links,
)
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
from ltvn_core.systems.temporal_distance import (
    EDGE_STEPS,
    NearestInTime,
    reachability_of_steps,
    temporal_cost,
    with_step_thresholds,
)
from ltvn_core.types import Features, FrameId, NodeId, Observation, Predictor

MAX_STEPS = 6.0 * EDGE_STEPS / 10.0
"""MAXDIST: largest predicted distance of joined pairs, and of the node at which the robot is localised. SoRB's value is
6 steps of a simulated point, for which SGM's edges are at most ten steps; it is scaled like SGM's cutoffs (ours)."""
BUFFER_SIZE = 1000
"""Largest number of images drawn as nodes, the size of the replay buffer in SoRB. Goals are always nodes."""


def sorb_system(method: Method) -> NavigationSystem:
    """Return SoRB; `method` has the thresholds of controller and success check, which are converted to steps."""
    scaled = with_step_thresholds(method)
    return NavigationSystem(
        name="sorb",
        method=scaled,
        build=partial(_build, method=scaled),
        edge_weight=temporal_cost,
        localise=NearestInTime(MAX_STEPS),
        subgoal=choose_goal_if_nearer,
        maintenance=NoMaintenance(),
    )


def choose_goal_if_nearer(path: Sequence[NodeId], reachability: Callable[[NodeId], float]) -> int:
    """Choose the goal itself if it is predicted within MAXDIST and not farther than the first node; otherwise the first
    node."""
    goal = reachability(path[-1])
    nearer = goal >= reachability_of_steps(MAX_STEPS) and goal >= reachability(path[1])
    return len(path) - 1 if nearer else 1


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
    """Return a map of images drawn with `rng`, including all `goals`."""
    ordered, features = encode_trajectory(observations, keyframes, predictor, goals)
    drawn = {*rng.permutation(len(ordered))[:BUFFER_SIZE].tolist()}
    chosen = [k for k, seen in enumerate(ordered) if k in drawn or seen.step in goals]
    kept, features = [ordered[k] for k in chosen], features[chosen]
    keyframes.keep_only([seen.step for seen in kept])
    near = _near_pairs(features, predictor, progress)
    links = surest_links(near, both_directions=method.matching.both_directions)
    return tuple(all_image_deltas(kept, links, method.believing))


def _near_pairs(features: Features, predictor: Predictor, progress: ProgressCallback | None) -> Iterator[EdgeCandidate]:
    """Yield the links between N images that are predicted within MAXDIST."""
    for k, found in enumerate(predict_all_pairs(features, predictor, progress)):
        near = (found.reachability > reachability_of_steps(MAX_STEPS)) & ~has_no_waypoint(found.waypoints)
        near[k] = False
        for other in np.flatnonzero(near).tolist():
            yield EdgeCandidate(k, other, found.reachability[other], found.waypoints[other])


SORB = SystemEntry(
    name="sorb",
    label="SoRB",
    factory=sorb_system,
    weights=shipped_weights("sorb"),
    learning=TemporalLearning(TemporalDistanceRule(), even_distances=False, added=EnsembleArchitecture()),
)
