"""Arrival and recovery: what the robot learns from a look around (ours).

The image of the goal decides where it can: where the predictor recognises it, where the map's own images say that it
looks different from beside, and where the place belief is sure. Otherwise the robot turns round once, and the images in
all directions decide. The belief alone is no arrival, because it also follows a robot that went astray. A robot that is
lost or has no path turns round as well, offers new images to the map, drives to tell places apart, and gives up.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ltvn_core.config import JudgingConfig
from ltvn_core.geometry import agree, distance, relative, wrap_angle
from ltvn_core.graph.place_belief import LIKELY, SURE
from ltvn_core.navigation import events as e
from ltvn_core.navigation.disambiguation import tell_apart
from ltvn_core.navigation.perception import EventGenerator, QueryAborted
from ltvn_core.navigation.query import QueryState, Survey
from ltvn_core.types import Waypoint

TURN_RAD, LOOKS_PER_TURN = 0.52, 12
"""Angle of the turn on the spot between two observations, and number of observations in a full turn."""


def recover(query: QueryState, why: e.Outcome) -> EventGenerator[None]:
    """Turn on the spot to look again, drive on after each full turn, and finally give up.

    Raises:
        QueryAborted: If the robot has looked around often enough.
    """
    yield from query.enter(e.NavigatorState.RECOVERING)
    if query.consecutive_failures == 0 or why is e.Outcome.NO_PATH:
        query.give_up_outcome = why
    query.consecutive_failures += 1
    query.first_looks += 1
    query.plan = ()
    is_lost = why is e.Outcome.LOST and query.perception.is_usable
    if is_lost:
        yield from _remember_novel(query)
    if query.consecutive_failures >= query.method.recovering.give_up_after_looks:
        raise QueryAborted(query.give_up_outcome)
    if query.consecutive_failures % LOOKS_PER_TURN == 0:
        if is_lost and (query.place_p() or 1.0) <= LIKELY and (yield from tell_apart(query, LIKELY)):
            return
        # The robot may be wrong about its way here, about doubted nodes, and about closed edges.
        query.begin_anew()
    yield from query.driver.turn(TURN_RAD)
    has_looked = is_lost and query.consecutive_failures >= LOOKS_PER_TURN and query.context.system.follows_places
    if has_looked and query.motion.path_m - query.began_at_m < _ONWARD_M / 2:
        yield from query.driver.wander(_ONWARD_M)


def turn_to_see(query: QueryState) -> EventGenerator[None]:
    """Turn as a lost robot does, but keep the plan, because localisation searches around it first."""
    plan = query.plan
    query.assumed_node = None  # After a turn the robot is no longer at the assumed node.
    yield from recover(query, e.Outcome.LOST)
    query.plan = plan


def _remember_novel(query: QueryState) -> Iterator[e.Event]:
    """Offer an unrecognised image to the system, which may make it a node."""
    context = query.context
    seen, features = query.perception.observation, query.perception.features
    unrecognised = context.system.maintenance.unrecognised
    if deltas := unrecognised(context.graph, seen, features, query.consecutive_failures, context.matcher):
        context.keyframes.add([seen], features)
        yield from query.apply(deltas)


AT_TARGET_M = 0.35
"""Largest distance from a target at which the robot is there by the place belief, in metres."""
_AT_TARGET, _HERE = (AT_TARGET_M, 0.3), np.zeros(3)
"""The same with the turn, in m and rad; the robot's pose in its own frame."""
_BESIDE_M, _BESIDE_RAD = (0.5, 1.5), 0.4
"""Distances from the goal of images that should not show it as reached, in m, and their largest turn from it."""
_ONWARD_M = 1.0
"""Distance to drive on after a turn that did not show the goal's place, in metres."""
_MOST_SURVEYS = 8
"""Number of turns at places that seem to be the goal after which the query is given up."""


class Arrival(NamedTuple):
    """How the robot knows that it is at the goal."""

    rule: str
    """Name in `config` of the rule that decided."""
    reachability: float
    """r of the goal in the last image."""
    distance: float
    """d of the goal, by the image or by the place belief."""


def check_goal(query: QueryState) -> EventGenerator[Arrival | None]:
    """Return the arrival if the image and the goal's neighbours in time match, and nothing speaks against it, or if the
    robot is sure to be there and a turn confirms it."""
    seen = query.perception.node_match(query.goal)
    looks_near = is_at_goal(seen.reachability, seen.waypoint, query.method.judging)
    if not looks_near or not query.is_recognised(query.perception.with_node_support(query.goal).reachability):
        # Along a bare wall, images of one place measure waypoints that differ by half a metre.
        known = query.known_waypoint(query.goal, SURE)
        return (yield from check_place(query)) if known is not None and agree(known, _HERE, _AT_TARGET) else None
    belief = query.places.belief()
    p = 1.0 if belief is None else belief.probability_at(query.motion.odometry, query.goal, seen.waypoint)
    if belief is None or (p > SURE and _looks_different_from_beside(query)):
        return Arrival(e.BY_IMAGE, seen.reachability, seen.distance)
    if p <= LIKELY:
        yield e.Note("This looks like the goal, but the whole query does not.", e.Severity.WARN, rule=e.BY_PLACE)
        return None
    return (yield from check_place(query))


def check_place(query: QueryState) -> EventGenerator[Arrival | None]:
    """Return the arrival if the images in all directions show that the robot is where the goal is; turn round for it.

    Raises:
        QueryAborted: The robot has turned round in vain often enough.
    """
    if not query.context.system.follows_places:
        seen = query.perception.node_match(query.goal)
        return Arrival(e.BY_WAYPOINT, seen.reachability, seen.distance)
    survey = yield from _survey(query)
    if not (survey.is_confirmed and query.nodes_around(SURE)):
        if not (yield from tell_apart(query, SURE)):
            yield from query.driver.wander(_ONWARD_M)
        query.survey = None
        return None
    known = query.surveyed_waypoint(query.goal)
    if known is None or not agree(known, _HERE, _AT_TARGET):
        return None
    return Arrival(e.BY_PLACE, query.perception.node_match(query.goal).reachability, float(distance(known)))


def is_at_goal(reachability: float, waypoint: Waypoint, config: JudgingConfig) -> bool:
    """Tell whether the goal at `waypoint` (3,) is reached, by the current image alone."""
    return bool(reachability > config.arrive_reachability and distance(waypoint) < config.arrive_distance)


def _survey(query: QueryState) -> EventGenerator[Survey]:
    """Turn round once, unless that was done near here; return whether the images show the believed place."""
    if (here := query.survey_here) is not None:
        return here
    if query.surveys >= _MOST_SURVEYS:
        raise QueryAborted(e.Outcome.LOST)
    query.surveys += 1
    expected = agreed = 0
    for _ in range(LOOKS_PER_TURN):
        yield from query.driver.turn(TURN_RAD)
        if (yield from query.perception.can_compare()):
            _ = query.perception.features  # The belief gets every image that is encoded.
            place = query.place()
            if place is not None and place.expects_image:
                expected += 1
                agreed += place.is_recognised
    query.survey = survey = Survey(query.motion.odometry, 3 * agreed >= max(expected, 1))
    if not survey.is_confirmed:
        yield e.Note(f"Of {expected} images around, {agreed} show the goal's place.", e.Severity.WARN, rule=e.BY_PLACE)
    return survey


def _looks_different_from_beside(query: QueryState) -> bool:
    """Tell whether no image of the map that was taken beside the goal would count as taken there."""
    place = query.place()
    if place is None or query.goal not in place.nodes:
        return True
    matcher = query.context.matcher
    around = [*place.nodes]
    poses = relative(place.nodes[query.goal], np.array([place.nodes[node] for node in around]))
    away_m = np.hypot(poses[:, 0], poses[:, 1])
    nearest, farthest = _BESIDE_M
    is_beside = (away_m > nearest) & (away_m < farthest) & (np.abs(wrap_angle(poses[:, 2])) < _BESIDE_RAD)
    seen = matcher.match(matcher.keyframes.features([query.goal]), [around[k] for k in np.flatnonzero(is_beside)])
    found = zip(seen.reachability, seen.waypoints, strict=True)
    return not any(is_at_goal(float(r), waypoint, query.method.judging) for r, waypoint in found)
