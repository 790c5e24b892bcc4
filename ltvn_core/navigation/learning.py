"""What an attempt shows: the verdict about it, the evidence for Eq. 3 and 4, and obstacles that the map does not show.

The network that created a false edge also accepts the end of it. The robust method therefore needs independent
evidence: the place belief, which uses all images on the way. Owns the verdict, the evidence, and the distinction
between new and known obstacles, on the path and beside it; the system's maintenance and presence decide how they change
the map, and `graph.presence.obstruction` which edges an obstacle closes.
"""

import itertools
import math
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.depth_points import obstacle_points, transform_points
from ltvn_core.cameras.depth_scan import DepthScan
from ltvn_core.config import Method
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.deltas import BeliefUpdated, PresenceObserved
from ltvn_core.graph.free_floor import thinned
from ltvn_core.graph.localiser import Localisation
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.place_belief import SURE
from ltvn_core.graph.planner import GraphPath
from ltvn_core.graph.presence.edge_presence import is_open
from ltvn_core.graph.presence.obstruction import (
    BODY_M,
    Obstruction,
    distances_to_way,
    edges_obstructed,
    nearby_poses,
    ways_nearby,
)
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.arrival import AT_TARGET_M
from ltvn_core.navigation.attempt_driver import AttemptResult
from ltvn_core.navigation.events import BY_PLACE, OBSTRUCTED_ENDS, AttemptEnd, Event
from ltvn_core.navigation.perception import NodeMatch
from ltvn_core.navigation.query import MOST_OBSTRUCTIONS, Departure, QueryState
from ltvn_core.types import NodeId, Pose, Waypoint

_SUCCESS_DISTANCE, _SUCCESS_REACHABILITY = "judging.success_distance", "judging.success_reachability"
_INCONCLUSIVE_ENDS = (AttemptEnd.BLOCKED, AttemptEnd.COLLISION, AttemptEnd.TIMEOUT)
"""Ends of attempts that say something about the surroundings, not about the edge."""
_AT_TARGET_DISTANCE = 0.3
"""Distance d below which the robot is at the target."""


class AttemptVerdict(NamedTuple):
    """Whether an attempt succeeded, and which rule decided."""

    succeeded: bool
    reason: str
    hindered: bool = False
    """Whether the attempt failed for a reason that says little about the edge."""
    rule: str = ""
    """Name of the rule in `config`; empty if it has none."""


def judge_attempt(
    reachability: float,
    target_distance: float,
    odometry_error: Waypoint,
    method: Method,
    *,
    fits_place: bool = True,
    hindered: bool = False,
    driven_too_often: bool = False,
) -> AttemptVerdict:
    """Judge an attempt by the arrival image o_d: it succeeded if the target is reachable and near.

    `odometry_error`: (3,) rest of the waypoint by odometry. `fits_place`: the place belief does not exclude the target.
    `hindered`: an obstacle, a collision or the step limit ended the attempt. `driven_too_often`: the attempts along the
    edge exceed their limit in this query.
    """
    judging = method.judging
    within = judging.success_distance or method.building.connect_distance
    needed = judging.success_reachability if judging.success_distance else method.building.connect_reachability
    if reachability <= needed:
        # If image and odometry both place the target here, it is probably here and only hard to recognise.
        at_target = max(target_distance, float(distance(odometry_error))) < _AT_TARGET_DISTANCE
        why = f"target does not look reachable: r = {reachability:.2f}, needs {needed:.2f}"
        return AttemptVerdict(False, why, hindered or at_target, rule=_SUCCESS_REACHABILITY)
    if target_distance >= within:
        why = f"target is still too far: d = {target_distance:.2f}, needs {within:.2f}"
        return AttemptVerdict(False, why, hindered, rule=_SUCCESS_DISTANCE)
    if not fits_place:
        why = "the images of the whole query say that the target is elsewhere"
        return AttemptVerdict(False, why, rule=BY_PLACE)
    if driven_too_often:
        return AttemptVerdict(False, "driven too often in this query", hindered=True, rule="planning.repeat_limit")
    why = f"target is near: d = {target_distance:.2f}, r = {reachability:.2f}"
    return AttemptVerdict(True, why, rule=_SUCCESS_DISTANCE)


def judge(query: QueryState, segment: Sequence[NodeId], result: AttemptResult) -> AttemptVerdict:
    """Judge an attempt along a path of nodes by the current image, the place belief and odometry."""
    source, target = segment[0], segment[-1]
    is_edge = len(segment) > 1
    driven_too_often = is_edge and query.count_drive((source, target))
    if not query.perception.is_usable:
        return AttemptVerdict(False, "the last image has no depth, so it cannot be judged", hindered=True)
    seen = query.perception.node_match(target)
    left = relative(query.motion.odometry, result.goal)
    place = query.place()
    verdict = judge_attempt(
        seen.reachability,
        seen.distance,
        left,
        query.method,
        fits_place=place is None or not place.rules_out(target, seen.waypoint, SURE),
        hindered=result.end in _INCONCLUSIVE_ENDS,
        driven_too_often=driven_too_often,
    )
    is_unsure = not verdict.succeeded and result.end is AttemptEnd.REACHED and not driven_too_often
    known = query.known_waypoint(target, SURE) if is_unsure and is_edge else None
    if known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M:
        if not query.is_recognised(seen.reachability):
            query.assumed_node = target  # The image does not show the target, only the belief does.
        why = "the images of the whole query say that the robot is there"
        return AttemptVerdict(True, why, rule=BY_PLACE)
    return verdict


_STEPS_OF_A_WAY = 10
"""Number of control steps after which the robot counts as having left the place of the last attempt."""
_EDGES_IN_SIGHT = 4
"""Number of edges at the beginning of a plan that are checked for obstacles."""


def look_for_obstacles(query: QueryState, path: GraphPath) -> Generator[Event, None, bool]:
    """Look for obstacles before an attempt; tell whether a new one closes the path, so that the robot replans."""
    graph = query.context.graph
    presence = query.context.system.presence
    now_s = query.now_s
    in_sight = path.nodes[: _EDGES_IN_SIGHT + 1]
    obstruction = obstruction_ahead(query, in_sight)
    if obstruction is None or not (across := edges_obstructed(graph, obstruction)):
        seen = [edge for edge in open_ways(query) if edge not in query.felt_closed]
        yield from query.apply(presence.observe_open(graph, seen, now_s))
        return False
    yield from query.apply(presence.observe(graph, obstruction, now_s))
    ahead = (edge for edge in itertools.pairwise(in_sight) if edge in across and not query.never_closed(edge))
    closed = [edge for edge in ahead if not is_open(graph, edge)]
    if not closed or query.obstructions >= MOST_OBSTRUCTIONS:
        return False
    query.obstructions += 1
    query.record_failures(across)  # So that this query tries other paths first.
    return True


def learn_from_attempt(
    query: QueryState,
    attempt: int,
    segment: Sequence[NodeId],
    node_match: NodeMatch,
    verdict: AttemptVerdict,
    result: AttemptResult,
) -> Iterator[Event]:
    """Remember a failure for this query, and let the system update the map."""
    context = query.context
    failed_before = any(edge in query.failed for edge in itertools.pairwise(segment))
    obstruction = None
    if not verdict.succeeded:
        query.record_failures(itertools.pairwise(segment))
        blocked = result.end in OBSTRUCTED_ENDS
        # A robot that is stopped before it moves is stopped by the same obstacle as before.
        again = False
        if blocked and result.steps >= _STEPS_OF_A_WAY:
            again = (segment[0], segment[-1]) in query.stopped
            query.stopped.add((segment[0], segment[-1]))
        obstruction = find_obstruction(query, segment, blocked=blocked, again=again)
        if obstruction is not None and obstruction.stopped:
            query.obstructions += 1
        else:
            query.record_failure_from(segment[0])  # No obstacle explains the failure.
    evidence = AttemptEvidence(
        source=segment[0],
        target=segment[-1],
        distance=node_match.distance,
        succeeded=verdict.succeeded,
        failed_before=failed_before,
        hindered=verdict.hindered,
        stamp=query.now_s,
        obstruction=obstruction,
    )
    deltas = context.system.maintenance.after_attempt(context.graph, evidence)
    if obstruction is not None and obstruction.stopped:
        observed = (each for each in deltas if isinstance(each, PresenceObserved))
        query.felt_closed.update((each.source, each.target) for each in observed)
    yield from query.apply(deltas, attempt)


def learn_from_action(query: QueryState, edge: EdgeKey, *, succeeded: bool) -> Iterator[BeliefUpdated]:
    """Yield updates of the belief in the existence of an edge with an action.

    The length of the edge was not measured, and only a person may remove it.
    """
    context = query.context
    known = context.graph.edges.get(edge)
    if known is None:
        return
    evidence = AttemptEvidence(*edge, distance=known.belief.mu, succeeded=succeeded, stamp=query.now_s)
    for delta in context.system.maintenance.after_attempt(context.graph, evidence):
        if isinstance(delta, BeliefUpdated):
            yield delta


_FREE_RANGE_M = 3.5
"""Range up to which floor may count as free, in metres; farther away, a door leaf seen at an angle looks like a gap."""
_BEHIND_M = 0.15
"""Distance behind a place up to which nothing may be seen if the place is free, in metres."""
_BEYOND_M = 0.25
"""Length before and behind a path that must also be free, in metres."""
_UNDERFOOT_M = 0.3
"""Radius of the area that the robot itself covers, in metres."""
_STEP_M = 0.08
"""Spacing of the places at which a path is checked, in metres."""


def shows_free(scan: DepthScan, way: NDArray[np.float64]) -> bool:
    """Tell whether an image shows a whole straight line (2, 2), start and end in the robot's frame, to be free.

    Both ends need free room as well, because an obstacle may stand just behind them.
    """
    along = (way[1] - way[0]) / max(float(np.hypot(*(way[1] - way[0]))), 1e-9)
    start = way[0] - _BEYOND_M * along
    end = way[1] + _BEYOND_M * along
    count = max(2, math.ceil(float(np.hypot(*(end - start))) / _STEP_M) + 1)
    places = np.linspace(start, end, count)
    away_m, bearing = scan.polar(places)
    asked = away_m > _UNDERFOOT_M
    away_m, bearing = away_m[asked], bearing[asked]
    if not asked.any() or not scan.inside(bearing).all() or away_m.max() > _FREE_RANGE_M:
        return False
    return bool(scan.shows_past(bearing, away_m + _BEHIND_M).all())


_RANGE_M = 2.5
"""Range up to which depth locates obstacles well enough, in metres."""
_KNOWN_WITHIN_M = 0.18
"""Distance to a point in an image of the map within which a point counts as known, in metres."""
_NODES = 12
"""Number of nearest nodes whose images show the known obstacles."""
_IMAGES_AROUND = 3
"""Number of images of the mapping drive before and after each of these nodes that are also used."""
_SURE_REACHABILITY = 0.8
_KNOWN_SHARE, _KNOWN_SHARE_IF_UNSURE = 0.5, 0.75
"""Share of known surroundings below which the robot's localisation is probably wrong; the second is for an unsure
localisation. In 62 checks in two apartments with closed doors, these limits accepted all 50 at the right place and none
of the 12 at a wrong place."""
_LEAST_POINTS = 8
"""Minimum number of new points that count as an obstruction."""
_LEAST_ON_WAY = 4
"""Minimum number of new points inside the robot's swept path."""
_GRID_M = 0.05
"""Width of a grid cell in which only one point is kept, in metres."""


def departure(query: QueryState, localisation: Localisation) -> Departure | None:
    """Return the place from where an attempt begins; None if it is not certain enough, or if the system does not use
    observations of presence."""
    if localisation.node is None or not query.context.system.follows_presence:
        return None
    if not query.is_recognised(localisation.reachability):
        return None
    unsure = localisation.reachability < _SURE_REACHABILITY
    share = _KNOWN_SHARE_IF_UNSURE if unsure else _KNOWN_SHARE
    return Departure(localisation.node, localisation.waypoint, query.motion.odometry, share)


def open_ways(query: QueryState) -> list[EdgeKey]:
    """Return the edges that were last seen closed, but whose paths are now seen to be free."""
    if query.departure is None:
        return []
    graph = query.context.graph
    closed = {key for key in graph.presence if not is_open(graph, key)}
    if not closed:
        return []
    back = invert(_here(query, query.departure))
    seen = query.perception.observation
    spec = query.context.spec
    scan = DepthScan.from_image(
        seen, spec.camera, np.zeros(3), height_m=spec.clear_height_m, trusted_m=2 * _FREE_RANGE_M
    )
    ways = {key: way for key, way in ways_nearby(graph, query.departure.node).items() if key in closed}
    return [key for key, way in ways.items() if shows_free(scan, transform_points(way, back))]


def obstruction_ahead(query: QueryState, segment: Sequence[NodeId]) -> Obstruction | None:
    """Return the new obstacles if anything lies across the path of a nearby edge, which is cheap to check."""
    if query.departure is None or len(segment) < 2:
        return None
    solid = _solid_points(query, _here(query, query.departure))
    anything = Obstruction(node=segment[0], points=solid, known=solid[:0], stopped=False)
    return find_obstruction(query, segment) if edges_obstructed(query.context.graph, anything) else None


def find_obstruction(
    query: QueryState, segment: Sequence[NodeId], *, blocked: bool = False, again: bool = False
) -> Obstruction | None:
    """Return the new obstacles around the robot on its path along nodes; None without any.

    Nothing is reported while the robot's place is uncertain. `blocked` means that an obstacle stopped the robot.
    `again` means that one stopped it on this edge before; the obstacle then counts as being in the way, even if no
    image shows it there.
    """
    if query.departure is None or len(segment) < 2:
        return None
    here = _here(query, query.departure)
    solid = _solid_points(query, here)
    is_new = _is_new(query, solid, segment[0], here)
    new = solid[is_new]
    if len(new) > (1 - query.departure.needed_share) * len(solid):
        return None
    if blocked:
        # An obstacle that was hit may be in no image, for instance behind a robot that backs up.
        hit = transform_points(query.driver.obstacles.hit_points(query.motion.odometry), here)
        if _is_new(query, hit, segment[0], here).all():  # Not beside a known one.
            new = np.concatenate([new, hit])
    stopped = blocked and (again or _is_on_way(query.context.graph, new, segment))
    if not stopped and len(new) < _LEAST_POINTS:
        return None
    return Obstruction(node=segment[0], points=new, known=solid[~is_new], stopped=stopped)


def _here(query: QueryState, left: Departure) -> Pose:
    """Return the robot's pose (3,) in the frame of the node that it departed from."""
    return compose(invert(left.waypoint), relative(left.odometry, query.motion.odometry))


def _solid_points(query: QueryState, here: Pose) -> NDArray[np.float64]:
    """Return (M, 2) solid points that a robot at a pose (3,) sees now or saw nearby recently, thinned out."""
    spec = query.context.spec
    depth = query.perception.observation.depth
    seen = obstacle_points(depth, spec.camera, _RANGE_M, height_m=spec.clear_height_m)
    remembered = query.driver.obstacles.nearby_points(query.motion.odometry, keeping_from_people=False)
    return thinned(transform_points(np.concatenate([seen, remembered]), here), _GRID_M)


def _is_new(query: QueryState, points: NDArray[np.float64], node: NodeId, here: Pose) -> NDArray[np.bool_]:
    """Return which points (M,), in the frame of a node, are far from all points in the images of the map."""
    poses = nearby_poses(query.context.graph, node)
    nearest = sorted(poses, key=lambda other: float(np.hypot(*(poses[other] - here)[:2])))[:_NODES]
    around = {other: poses[other] for other in nearest}
    mapped = query.perception.mapped_points(around, _IMAGES_AROUND, query.context.spec, range_m=2 * _RANGE_M)
    mapped = thinned(mapped, _GRID_M)
    if not len(mapped) or not len(points):
        return np.ones(len(points), np.bool_)
    gaps, _ = KDTree(mapped).query(points)
    return np.asarray(gaps) > _KNOWN_WITHIN_M


def _is_on_way(graph: TopologicalGraph, points: NDArray[np.float64], segment: Sequence[NodeId]) -> bool:
    """Tell whether points in the frame of the first node lie in the path of the robot's body."""
    start = np.zeros(3)
    for edge in itertools.pairwise(segment):
        end = compose(start, np.array(graph.edges[edge].waypoint))
        if (distances_to_way(points, start[:2], end[:2]) <= BODY_M).sum() >= _LEAST_ON_WAY:
            return True
        start = end
    return False
