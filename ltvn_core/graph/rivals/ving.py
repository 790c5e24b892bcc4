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
from ltvn_core.graph.builder import Progress, check_trajectory
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.localizer import GLOBAL, Fix, Recall, best_fix
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.rivals.all_images import Link, each_with_all, nodes_and_edges, passed_over, take_in
from ltvn_core.graph.system import Deltas, System, Untouched, first_node
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.types import Features, FrameId, Observation, Prediction, Predictor

TAU_STEPS = 8.0
"""The temporal distance at which the network's r has fallen to 1 / e; its labels are drawn with the same."""
EDGE_STEPS = 8.0
"""Images that seem no farther apart than this are joined, and the robot is at a node no farther away."""
_LEAST_P = 1e-6


def closeness(steps: float) -> float:
    """Return r of a temporal distance in steps."""
    return math.exp(-steps / TAU_STEPS)


def temporal_distance(p: float) -> float:
    """Return the steps that r stands for."""
    return -TAU_STEPS * math.log(max(p, _LEAST_P))


def ving(method: Method) -> System:
    """Return ViNG; `method` has the thresholds of the controller and of judging, whose r is put into steps."""
    scaled = _in_steps(method)
    return System(
        name="ving",
        method=scaled,
        build=partial(_build, method=scaled),
        edge_weight=_weight,
        localise=_localise,
        subgoal=first_node,
        maintenance=Untouched(),
    )


def _in_steps(method: Method) -> Method:
    """Return the method with "looks reachable" meaning "no farther than an edge" wherever the navigator asks."""
    edge = closeness(EDGE_STEPS)
    driving = replace(
        method.driving,
        departure_reachability=edge if method.driving.departure_reachability else 0.0,
        lost_reachability=closeness(2 * EDGE_STEPS),
    )
    judging = replace(method.judging, success_reachability=edge, arrive_reachability=closeness(EDGE_STEPS / 2))
    # A failure should weigh as much against edges of several steps as it does against edges of a metre.
    penalty = method.planning.failure_penalty * EDGE_STEPS
    return replace(
        method,
        driving=driving,
        judging=judging,
        planning=replace(method.planning, failure_penalty=penalty),
        building=replace(method.building, connect_reachability=edge),
    )


def _weight(belief: Belief) -> float:
    # Nothing was ever labelled nearer than a step; where the network exaggerates, a detour would cost nothing.
    return max(1.0, temporal_distance(belief.p))


def _localise(image: Features, graph: TopologicalGraph, recall: Recall, matcher: Matcher) -> Fix:
    """Find the node at the least temporal distance, if that is no more than an edge's."""
    matches = matcher.match(image, recall.candidates(graph))
    steps = np.array([temporal_distance(r) for r in matches.reachability])
    return best_fix(matches, steps, matches.reachability >= closeness(EDGE_STEPS), GLOBAL)


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
    links: dict[tuple[int, int], Link] = {}
    for k, found in enumerate(each_with_all(features, predictor, progress)):
        for link in _near(k, found, features, predictor):
            _keep_nearer(links, link)
            if method.matching.both_directions:
                _keep_nearer(links, link.reversed())
    return tuple(nodes_and_edges(ordered, links.values(), method.believing))


def _keep_nearer(links: dict[tuple[int, int], Link], link: Link) -> None:
    ends = link.source, link.target
    if ends not in links or links[ends].p < link.p:
        links[ends] = link


def _near(k: int, found: Prediction, features: Features, predictor: Predictor) -> Iterator[Link]:
    """Yield the links from image k to those that seem near, and to the next one, to which the drive went in a step."""
    near = (found.reachability >= closeness(EDGE_STEPS)) & ~passed_over(found.waypoints)
    following = k + 1
    near[k] = near[following : following + 1] = False
    for other in np.flatnonzero(near):
        yield Link(k, int(other), found.reachability[other], found.waypoints[other])
    if following < len(features):
        onward = predictor.predict(features[k : k + 1], features[following : following + 1])
        yield Link(k, following, closeness(1.0), onward.waypoints[0])
