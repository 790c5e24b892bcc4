"""Advice while mapping: what the map still lacks, and where to drive next.

Owns the search for loops that were driven but not closed and for places seen from one side only, from the map and
odometry, and the order in which to close these gaps.
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.findings import Finding, Severity
from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Pose

SAME_PLACE_M = 0.8
"""Distance by odometry, in metres, below which two nodes are at the same place."""
_NEAR_RAD = 0.5
"""Difference of heading, in radians, below which two nodes have the same view."""
_AWAY_M = 3.0
"""Least distance driven between two passes of a place, in metres, so that they count as two visits."""
_HOPS = 6
"""Number of edges up to which two nodes count as well connected."""
_JUMP_M = 1.5
"""Distance between consecutive poses, in metres, above which odometry jumped."""
_CELL_M = 1.0
HEADING_SECTORS = 8
"""Number of heading sectors of 45 degrees, centred on the axes and the diagonals."""
_OPPOSITE = 3
"""Least number of sectors between two headings that look to different sides."""
_MIN_IMAGES = 3
"""Least number of images of a place."""
_KNOWN = 0.5
"""Best r above which a view shows nothing new."""
_AHEAD_M = 1.0
_STRAY = 2
"""Least number of nodes of a component that is worth a drive."""
_HERE_M = 0.5


@dataclass(frozen=True, slots=True)
class MissingLoopClosure:
    """Two nodes at one place, from two visits, without an edge or a short path between them."""

    first: NodeId
    second: NodeId
    gap_m: float
    """Distance of the two nodes by odometry, in metres; odometry drifts, so the loop is a guess."""


@dataclass(frozen=True, slots=True, eq=False)
class OneSidedPlace:
    """A place where the camera always looked to the same side."""

    x_m: float
    y_m: float
    """Mean of the poses at the place, in metres."""
    yaw_rad: float
    """Mean heading, in radians."""
    images: int
    """Number of images at the place."""


@dataclass(frozen=True, slots=True)
class MappingAdvice:
    """What a map lacks while it is being collected, and the advice for the driver."""

    strongly_connected_components: tuple[tuple[NodeId, ...], ...]
    """Strongly connected components, the largest first; one is ideal."""
    missing_closures: tuple[MissingLoopClosure, ...]
    """Places that were visited twice without a loop closure."""
    one_sided_places: tuple[OneSidedPlace, ...]
    """Places seen from one side only."""
    novelty: float | None
    """1 - best r of the current view to any node: 0 = known, 1 = new; None if the view was not compared."""
    hint: Finding
    """Where to drive next, and why."""
    target: PoseRow | None
    """A pose in the odometry frame to drive to; None if any direction is equally good."""


def advise_mapping(
    graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose, current: Matches | None = None
) -> MappingAdvice:
    """Return what the map lacks so far, and one hint where to drive next.

    `steps` (T,), ascending, and odometry `poses` (T, 3) are the drive so far, up to the present pose. `current` is the
    present view compared with the nodes, as returned by `Matcher.match`. Linear in images, nodes and edges.
    """
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    components = strongly_connected_components(graph)
    missing_closures = find_missing_loop_closures(graph, steps, poses)
    places = one_sided_places(poses)
    novelty = None if current is None else 1 - float(np.max(current.reachability, initial=0.0))
    hint, target = _hint(graph, poses, components, missing_closures, places, novelty)
    return MappingAdvice(
        strongly_connected_components=components,
        missing_closures=missing_closures,
        one_sided_places=places,
        novelty=novelty,
        hint=hint,
        target=target,
    )


def find_missing_loop_closures(
    graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose
) -> tuple[MissingLoopClosure, ...]:
    """Return where the drive came back but no short path in the map joins the two visits; the closest pair per place.

    `steps` (T,), ascending, and odometry `poses` (T, 3) are the drive so far. Nodes of other drives count as another
    visit. Linear in T, in nodes, and in pairs of nodes at one place.
    """
    nodes = list(graph.nodes.values())
    if len(nodes) < 2:
        return ()
    places = np.array([node.odometry for node in nodes])
    driven = _driven_m(np.array([node.id for node in nodes]), np.asarray(steps), np.asarray(poses))
    found: list[tuple[float, int, int]] = []
    for k, others in _at_one_place(places):
        gaps = np.hypot(*(places[others] - places[k])[:, :2].T)
        turned = np.abs(wrap_angle(places[others, 2] - places[k, 2]))
        twice = (gaps < SAME_PLACE_M) & (turned < _NEAR_RAD) & ~(np.abs(driven[others] - driven[k]) < _AWAY_M)
        if twice.any():
            close = _reached(graph, nodes[k].id)
            chosen = zip(gaps[twice], others[twice], strict=True)
            found += [(float(gap), k, int(j)) for gap, j in chosen if nodes[j].id not in close]
    return tuple(MissingLoopClosure(nodes[k].id, nodes[j].id, gap) for gap, k, j in _thinned(sorted(found), places))


def one_sided_places(poses: Pose) -> tuple[OneSidedPlace, ...]:
    """Return the places, squares of 1 m, where all odometry `poses` (T, 3) look to the same side. Linear in T."""
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    cells = np.floor(poses[:, :2] / _CELL_M).astype(np.int64)
    _, owner, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sector = np.round(poses[:, 2] / (2 * np.pi / HEADING_SECTORS)).astype(np.int64) % HEADING_SECTORS
    histograms = np.bincount(owner.ravel() * HEADING_SECTORS + sector, minlength=len(counts) * HEADING_SECTORS).reshape(
        -1, HEADING_SECTORS
    )
    weights = (poses[:, 0], poses[:, 1], np.cos(poses[:, 2]), np.sin(poses[:, 2]))
    sums = [np.bincount(owner.ravel(), each, len(counts)) for each in weights]
    seen = histograms > 0
    apart = range(_OPPOSITE, HEADING_SECTORS - _OPPOSITE + 1)
    other_sides = np.any([seen & np.roll(seen, shift, axis=1) for shift in apart], axis=(0, 2))
    found = []
    for k in np.flatnonzero((counts >= _MIN_IMAGES) & ~other_sides):
        x, y, cos, sin = (float(each[k]) for each in sums)
        count = int(counts[k])
        found.append(OneSidedPlace(x_m=x / count, y_m=y / count, yaw_rad=float(np.arctan2(sin, cos)), images=count))
    return tuple(found)


def _driven_m(nodes: NDArray[np.int64], steps: NDArray[np.int64], poses: Pose) -> NDArray[np.float64]:
    """Return the metres (N,) driven up to each node; NaN for a node that is not on the drive. A jump of odometry counts
    as a long drive."""
    if not len(steps):
        return np.full(len(nodes), np.nan)
    moves = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    # A jump counts as a long drive, so that what lies before and after it are two visits.
    path = np.concatenate([[0.0], np.cumsum(np.where(moves > _JUMP_M, 1e6, moves))])
    row = np.clip(np.searchsorted(steps, nodes), 0, len(steps) - 1)
    return np.where(steps[row] == nodes, path[row], np.nan)


def _at_one_place(places: Pose) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield each row of (N, 3) with the earlier rows in its square and the eight squares around it."""
    squares: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (x, y) in enumerate(np.floor(places[:, :2] / SAME_PLACE_M).astype(int).tolist()):
        around = itertools.product((x - 1, x, x + 1), (y - 1, y, y + 1))
        others = [j for square in around if square in squares for j in squares[square]]
        squares[x, y].append(k)
        if others:
            yield k, np.array(others, np.intp)


def _reached(graph: TopologicalGraph, start: NodeId) -> set[NodeId]:
    """Return the nodes within a few edges of a node, in either direction."""
    reached = {start}
    frontier = [start]
    for _ in range(_HOPS):
        beside = {other for node in frontier for other in (*graph.successors(node), *graph.predecessors(node))}
        frontier = list(beside - reached)
        reached |= beside
    return reached


def _thinned(found: Sequence[tuple[float, int, int]], places: Pose) -> Iterator[tuple[float, int, int]]:
    """Yield the closest pair of each place."""
    kept: list[NDArray[np.float64]] = []
    for gap, k, j in found:
        here = places[k, :2]
        if all(np.hypot(*(here - other)) > 2 * SAME_PLACE_M for other in kept):
            kept.append(here)
            yield gap, k, j


def _hint(
    graph: TopologicalGraph,
    poses: Pose,
    components: Sequence[Sequence[NodeId]],
    missing_closures: Sequence[MissingLoopClosure],
    places: Sequence[OneSidedPlace],
    novelty: float | None,
) -> tuple[Finding, PoseRow | None]:
    """Return the gap to close first, and the pose to drive to: gaps that make goals unreachable come before gaps that
    only add detail."""
    if not len(poses):
        return Finding("Drive a little, so that there is something to see.", Severity.INFO), None
    here = poses[-1]
    worth = [component for component in components if len(component) >= _STRAY]
    if len(worth) >= 2:
        gap, node = sorted(min((_apart(graph, here, node), node) for node in component) for component in worth)[1]
        text, target = f"The map is in {len(worth)} pieces.", graph.nodes[node].odometry
        way = f"Drive to node {node}, {_way(here, target)}"
        way = "Drive from there back to where you are" if gap < _HERE_M else way
        remedy = f"{way}, with the camera facing forward, so that the pieces join."
    elif missing_closures:
        loop = min(missing_closures, key=lambda each: _apart(graph, here, each.first))
        text = f"Nodes {loop.first} and {loop.second} are the same place on two visits, but no edge joins them."
        target = graph.nodes[loop.first].odometry
        remedy = f"Drive through it again, {_way(here, target)}."
    elif novelty is not None and 1 - novelty <= _KNOWN:
        text, remedy = "This view is new.", "Continue slowly, so that the next images join it to the map."
        target = pose_row(here + np.array([_AHEAD_M * np.cos(here[2]), _AHEAD_M * np.sin(here[2]), 0.0]))
    elif places:
        place = min(places, key=lambda each: math.hypot(each.x_m - here[0], each.y_m - here[1]))
        target = PoseRow(place.x_m, place.y_m, float(wrap_angle(place.yaw_rad + math.pi)))
        text, remedy = "One place was seen from one side only.", f"Look the other way there, {_way(here, target)}."
    else:
        # At the edge of the driven area something new is most likely.
        middle = poses[:, :2].mean(axis=0)
        rim = poses[int(np.argmax(np.hypot(*(poses[:, :2] - middle).T)))]
        target = PoseRow(float(rim[0]), float(rim[1]), float(np.arctan2(*(rim[:2] - middle)[::-1])))
        text, remedy = "All is well here.", f"Drive beyond what you have seen, {_way(here, target)}."
    return Finding(text, Severity.INFO, remedy), target


def _apart(graph: TopologicalGraph, here: Pose, node: NodeId) -> float:
    x, y, _ = graph.nodes[node].odometry
    return math.hypot(x - here[0], y - here[1])


def _way(here: Pose, target: PoseRow) -> str:
    """Return the direction and distance of a pose from the robot, as text."""
    dx, dy, _ = (float(value) for value in relative(here, np.array(target)))
    away = math.hypot(dx, dy)
    if away < _HERE_M:
        return "right where you are"
    bearing = math.degrees(math.atan2(dy, dx))
    side = "to the left" if bearing > 0 else "to the right"
    if abs(bearing) < 25:
        side = "straight ahead"
    elif abs(bearing) > 155:
        side = "behind you"
    return f"{away:.1f} m away {side}"
