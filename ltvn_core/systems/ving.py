"""ViNG (Shah et al. 2021) as the paper ran it: all images, directed edges weighted with predicted temporal distance.

Owns its rules for edges and localisation, and what r means to it: its network says r = exp(-steps / TAU), where a step
is from one image of a drive to the next. Where the method asks the network both ways, an edge may be the way back of
another, driven in reverse. Driving teaches nothing. The pose estimator and the controller are those of all systems;
only their thresholds of r are put into steps.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.systems.all_image_map import (
    EdgeCandidate,
    all_image_deltas,
    consecutive_rows,
    encode_trajectory,
    has_no_waypoint,
    predict_all_pairs,
)
from ltvn_core.systems.entry import SystemEntry
from ltvn_core.training.system_training import TemporalTraining
from ltvn_core.training_data.temporal_rules import TAU_STEPS, TemporalDistanceRule
from ltvn_core.types import Features, FrameId, Observation, Prediction, Predictor

EDGE_STEPS = 8.0
"""Images that seem no farther apart than this are joined, and the robot is at a node no farther away."""
_MIN_P = 1e-6


def reachability_of_steps(steps: float) -> float:
    """Return r of a temporal distance in steps."""
    return math.exp(-steps / TAU_STEPS)


def temporal_distance(p: float) -> float:
    """Return the steps that r stands for."""
    return -TAU_STEPS * math.log(max(p, _MIN_P))


def ving_system(method: Method) -> NavigationSystem:
    """Return ViNG; `method` has the thresholds of the controller and of judging, whose r is put into steps."""
    scaled = with_step_thresholds(method)
    return NavigationSystem(
        name="ving",
        method=scaled,
        build=partial(_build, method=scaled),
        edge_weight=_temporal_cost,
        localise=_localise,
        subgoal=choose_first_node,
        maintenance=NoMaintenance(),
    )


def with_step_thresholds(method: Method) -> Method:
    """Return the method with "looks reachable" meaning "no farther than an edge" wherever the navigator asks."""
    edge = reachability_of_steps(EDGE_STEPS)
    driving = replace(
        method.driving,
        departure_reachability=edge if method.driving.departure_reachability else 0.0,
        lost_reachability=reachability_of_steps(2 * EDGE_STEPS),
    )
    judging = replace(
        method.judging, success_reachability=edge, arrive_reachability=reachability_of_steps(EDGE_STEPS / 2)
    )
    # A failure should weigh as much against edges of several steps as it does against edges of a metre.
    penalty = method.planning.failure_penalty * EDGE_STEPS
    return replace(
        method,
        driving=driving,
        judging=judging,
        planning=replace(method.planning, failure_penalty=penalty),
        building=replace(method.building, connect_reachability=edge),
    )


def _temporal_cost(belief: Belief) -> float:
    # Nothing was ever labelled nearer than a step; where the network exaggerates, a detour would cost nothing.
    return max(1.0, temporal_distance(belief.p))


def _localise(features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher) -> Localisation:
    """Find the node at the least temporal distance, if that is no more than an edge's."""
    matches = matcher.match(features, prior.candidates(graph))
    steps = np.array([temporal_distance(r) for r in matches.reachability])
    return best_localisation(matches, steps, matches.reachability >= reachability_of_steps(EDGE_STEPS), GLOBAL)


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
    candidates: dict[tuple[int, int], EdgeCandidate] = {}
    followed = {row for row, _ in consecutive_rows(ordered, keyframes)}
    for k, found in enumerate(predict_all_pairs(features, predictor, progress)):
        for candidate in _close_candidates(k, found, features, predictor, is_followed=k in followed):
            _keep_shorter(candidates, candidate)
            if method.matching.both_directions:
                _keep_shorter(candidates, candidate.reversed())
    return tuple(all_image_deltas(ordered, candidates.values(), method.believing))


def _keep_shorter(candidates: dict[tuple[int, int], EdgeCandidate], candidate: EdgeCandidate) -> None:
    ends = candidate.source, candidate.target
    if ends not in candidates or candidates[ends].p < candidate.p:
        candidates[ends] = candidate


def _close_candidates(
    k: int, found: Prediction, features: Features, predictor: Predictor, *, is_followed: bool
) -> Iterator[EdgeCandidate]:
    """Yield the links from image k to those that seem near, and to the next one, to which the drive went in a step.

    `is_followed`: the drive went on after it.
    """
    near = (found.reachability >= reachability_of_steps(EDGE_STEPS)) & ~has_no_waypoint(found.waypoints)
    following = k + 1
    near[k] = False
    if is_followed:
        near[following] = False
    for other in np.flatnonzero(near):
        yield EdgeCandidate(k, int(other), found.reachability[other], found.waypoints[other])
    if is_followed:
        onward = predictor.predict(features[k : k + 1], features[following : following + 1])
        yield EdgeCandidate(k, following, reachability_of_steps(1.0), onward.waypoints[0])


VING = SystemEntry(
    name="ving",
    label="ViNG",
    factory=ving_system,
    weights=shipped_weights("ving"),
    training=TemporalTraining(TemporalDistanceRule(), even_distances=False),
)
