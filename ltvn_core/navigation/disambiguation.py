"""Disambiguation: a robot that could be at several places that look alike drives to where the map tells them apart.

Until then an image of the goal proves nothing, because a look-alike of the goal shows the same. Owns when the robot
does so, and where it drives (ours).
"""

from collections.abc import Mapping

import numpy as np

from ltvn_core.geometry import compose, relative
from ltvn_core.graph.place_belief import LIKELY
from ltvn_core.navigation import events as e
from ltvn_core.navigation.perception import EventGenerator
from ltvn_core.navigation.query import QueryState
from ltvn_core.types import NodeId, Pose

_NEAREST_M, _FARTHEST_M, _SPACING_M = 1.0, 16.0, 1.5
"""Distances of the places to choose from, and the least distance between two of them, in metres."""
_LOOKED_M = 1.0
"""Distance from where the robot has looked within which it learns nothing new, in metres."""
_LEAST_TOLD = 0.05
"""Least probability of the places that a way must tell apart."""
_EFFORT_M = 5.0
"""Length added to each way, in metres, so that the robot does not stop for every small difference."""


def is_ambiguous(query: QueryState) -> bool:
    """Tell whether the robot is probably not at the likeliest place, and more probably at one that looks like it."""
    p, belief = query.place_p(), query.places.belief()
    return p is not None and belief is not None and p <= LIKELY and belief.look_alike_p() > p


def tell_apart(query: QueryState, enough: float) -> EventGenerator[bool]:
    """Drive to a node that shows at which of several places the robot is, until one of them is more probable than
    `enough`; return whether that led anywhere."""
    way = _way(query)
    if not way:
        return False
    text = f"The images fit several places that look alike; the robot drives over {len(way)} nodes to tell them apart."
    yield e.Note(text, rule=e.BY_PLACE)
    yield from query.enter(e.NavigatorState.DRIVING)
    steps_before, before_m = query.motion.steps, query.motion.path_m
    for node, pose in way.items():
        # The robot keeps to its way though another place may have become the likeliest one.
        waypoint = relative(query.motion.odometry, pose)
        result = yield from query.driver.drive(node, waypoint, is_known=True, around=query.nodes_around(0.0))
        if query.perception.is_usable:
            _ = query.perception.features  # The belief gets every image that is encoded.
        query.looked_from += [query.motion.odometry.copy(), pose]  # The way to that pose may be blocked.
        if result.end is not e.AttemptEnd.REACHED or (query.place_p() or 0.0) > enough:
            break
    if query.motion.steps == steps_before:
        yield from query.motion.wait_one_step()
    return query.motion.path_m - before_m > _LOOKED_M / 2


def _way(query: QueryState) -> dict[NodeId, Pose]:
    """Return the nodes of the way that tells most places apart for its length and its detour from the way to the goal,
    with their poses (3,) in the odometry frame; empty if none does."""
    odometry, planner, belief = query.motion.odometry, query.context.planner, query.places.belief()
    around = {} if belief is None else belief.nodes_within(odometry, _FARTHEST_M)
    candidates = _candidates(query, around)
    if belief is None or not candidates:
        return {}
    start = next(iter(around))
    told = belief.told_apart(np.array([around[node] for node in candidates]))
    direct = planner.plan(start, query.goal, query.penalties)
    best, way = 0.0, dict[NodeId, Pose]()
    for node, share in zip(candidates, told.tolist(), strict=True):
        if share < _LEAST_TOLD or share / _EFFORT_M <= best:
            continue
        there, onward = planner.plan(start, node, query.penalties), planner.plan(node, query.goal, query.penalties)
        if not there.nodes or not all(each in around for each in there.nodes):
            continue
        detour_m = there.cost + onward.cost - direct.cost if direct.nodes and onward.nodes else there.cost
        gain = share / (_EFFORT_M + there.cost + max(detour_m, 0.0))
        if gain > best:
            best, way = gain, {each: compose(odometry, around[each]) for each in there.nodes[1:]}
    return way


def _candidates(query: QueryState, around: Mapping[NodeId, Pose]) -> list[NodeId]:
    """Return some of the nodes around (3,), the nearest first, none beside another or where the robot has looked."""
    looked_from = [relative(query.motion.odometry, pose) for pose in query.looked_from]
    chosen = list[NodeId]()
    taken = np.array([np.zeros(3), *looked_from])[:, :2]
    least_m = np.array([_NEAREST_M, *[_LOOKED_M] * len(looked_from)])
    for node, pose in around.items():
        if (np.hypot(*(taken - pose[:2]).T) >= least_m).all():
            chosen.append(node)
            taken = np.concatenate([taken, pose[None, :2]])
            least_m = np.append(least_m, _SPACING_M)
    return chosen
