"""ViNG (Shah et al. 2021) as the paper ran it: all images, directed edges weighted with predicted temporal distance.

Owns its rules for edges. Its network predicts r = exp(-steps / TAU), and images at most `EDGE_STEPS` apart are joined.
If the method compares both directions, an edge can also be the edge of the other direction, driven in reverse. The map
does not change while driving. The pose estimator and the controller are the same as in all systems; only their
thresholds of r are converted to steps.
"""

from collections.abc import Collection, Iterator, Sequence
from functools import partial

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalDistanceRule
from ltvn_core.systems.all_image_map import (
    EdgeCandidate,
    all_image_deltas,
    consecutive_rows,
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
from ltvn_core.types import Features, FrameId, Observation, Prediction, Predictor


def ving_system(method: Method) -> NavigationSystem:
    """Return ViNG; `method` has the thresholds of controller and success check, which are converted to steps."""
    scaled = with_step_thresholds(method)
    return NavigationSystem(
        name="ving",
        method=scaled,
        build=partial(_build, method=scaled),
        edge_weight=temporal_cost,
        localise=NearestInTime(EDGE_STEPS),
        subgoal=choose_first_node,
        maintenance=NoMaintenance(),
    )


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
    followed = {row for row, _ in consecutive_rows(ordered, keyframes)}
    close = (
        candidate
        for k, found in enumerate(predict_all_pairs(features, predictor, progress))
        for candidate in _close_candidates(k, found, features, predictor, is_followed=k in followed)
    )
    links = surest_links(close, both_directions=method.matching.both_directions)
    return tuple(all_image_deltas(ordered, links, method.believing))


def _close_candidates(
    k: int, found: Prediction, features: Features, predictor: Predictor, *, is_followed: bool
) -> Iterator[EdgeCandidate]:
    """Yield the links from image k to all images that are predicted near it, and to the next image, one step away.

    `is_followed` tells whether the drive continued after image k.
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
    learning=TemporalLearning(TemporalDistanceRule(), even_distances=False),
)
