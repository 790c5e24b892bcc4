"""Finds obstacles around the robot that were not there when the map was made.

Owns the distinction between new and known obstacles, and between obstacles on the path and beside it.
`graph.presence.obstruction` finds the edges that they close.
"""

import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.depth_points import cell_keys, map_points, obstacle_points, transform_points
from ltvn_core.cameras.depth_scan import DepthScan
from ltvn_core.geometry import compose, invert, relative
from ltvn_core.graph.localiser import Localisation
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
from ltvn_core.navigation.query import Departure, QueryState
from ltvn_core.types import NodeId, Pose

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
    return _thinned(transform_points(np.concatenate([seen, remembered]), here))


def _is_new(query: QueryState, points: NDArray[np.float64], node: NodeId, here: Pose) -> NDArray[np.bool_]:
    """Return which points (M,), in the frame of a node, are far from all points in the images of the map."""
    poses = nearby_poses(query.context.graph, node)
    nearest = sorted(poses, key=lambda other: float(np.hypot(*(poses[other] - here)[:2])))[:_NODES]
    spec = query.context.spec
    read = partial(map_points, camera=spec.camera, range_m=2 * _RANGE_M, height_m=spec.clear_height_m)
    mapped = _thinned(query.perception.mapped_points({other: poses[other] for other in nearest}, _IMAGES_AROUND, read))
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


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    cells = np.round(points / _GRID_M).astype(np.int64)
    _, kept = np.unique(cell_keys(cells), return_index=True)
    return points[kept]
