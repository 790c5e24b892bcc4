"""What is weak in a map and where to drive next: one list of findings in one ranking.

Owns the search for pieces, loops that were driven but not closed, places seen from one side only, edges that odometry
contradicts, and the gap between two nodes. Uses the map and its odometry, neither ground truth nor images. Odometry
drifts, so the findings are hints and not proofs.
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rustworkx
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.findings import Finding, Severity
from ltvn_core.geometry import distance, relative, wrap_angle
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.planner import mirrored, strongly_connected_components
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Pose

_SAME_PLACE_M = 0.8
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
_HEADING_SECTORS = 8
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
_LEAST_GAP_M = 1.5
"""Least disagreement between an edge and odometry that counts as a contradiction (ours)."""
_USUAL_QUANTILE = 0.95
"""Quantile of the disagreement over a map's edges that counts as usual (ours)."""
_TIMES_USUAL = 3.0
"""Least ratio of a contradiction to the usual disagreement (ours)."""
_NEIGHBOURS = 16
"""Number of neighbours beyond a gap that are compared with each node before the gap."""
_NEAREST = 5
"""Number of pairs across a gap that are named."""


class MapFinding(NamedTuple):
    """One weakness of a map, and what to look at."""

    finding: Finding
    target: PoseRow | None = None
    """A pose in the odometry frame to drive to; None if any direction is equally good."""
    pairs: tuple[tuple[EdgeKey, float], ...] = ()
    """Pairs of nodes to look at, with their distance: in metres, or d of Eq. 2 across a gap, both by odometry."""
    nodes: tuple[NodeId, ...] = ()
    """Nodes of pieces of the map other than the largest."""


def map_findings(
    graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose, current: Matches | None = None
) -> tuple[MapFinding, ...]:
    """Return what is weak in a map, the most important first; the first one with a target says where to drive next.

    Weaknesses that make goals unreachable come before those that only add detail, near ones before far ones, and facts
    without a remedy last. `steps` (T,), ascending, and odometry `poses` (T, 3) are the drive so far, up to the present
    pose. `current` is the present view compared with the nodes, as returned by `Matcher.match`. Linear in images, nodes
    and edges.
    """
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    if not len(poses):
        return (_found("Drive a little, so that there is something to see."),)
    here = poses[-1]
    found = [
        *_pieces(graph, here),
        *unclosed_loops(graph, steps, poses),
        *_view(here, current),
        *one_sided_places(poses),
        *contradicted_edges(graph),
    ]
    if not any(each.target for each in found):
        is_well = not any(each.finding.remedy for each in found)
        found.append(_rim(poses, "All is well here." if is_well else "All else is well here."))
    return tuple(sorted(found, key=lambda each: not each.finding.remedy))


def _found(text: str, remedy: str = "", target: PoseRow | None = None) -> MapFinding:
    return MapFinding(Finding(text, Severity.INFO, remedy), target)


def _pieces(graph: TopologicalGraph, here: Pose) -> Iterator[MapFinding]:
    """Yield the number of strongly connected components, and how to join the two nearest of those that are worth it."""
    pieces = strongly_connected_components(graph)
    if len(pieces) < 2:
        if pieces:
            yield _found("The map is in one piece.")
        return
    text, apart = f"The map is in {len(pieces)} pieces.", tuple(node for piece in pieces[1:] for node in piece)
    worth = [piece for piece in pieces if len(piece) >= _STRAY]
    if len(worth) < 2:
        yield _found(text)._replace(nodes=apart)
        return
    poses = {node: graph.nodes[node].odometry for node in graph.nodes}
    gap, node = sorted(min((_apart(here, poses[node]), node) for node in piece) for piece in worth)[1]
    way = f"Drive to node {node}, {_way(here, poses[node])}"
    way = "Drive from there back to where you are" if gap < _HERE_M else way
    remedy = f"{way}, with the camera facing forward, so that the pieces join."
    yield _found(text, remedy, poses[node])._replace(nodes=apart)


def unclosed_loops(graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose) -> tuple[MapFinding, ...]:
    """Return where the drive came back but no short path in the map joins the two visits; the closest pair per place.

    `steps` (T,), ascending, and odometry `poses` (T, 3) are the drive so far; the loop nearest to its end comes first.
    Nodes of other drives count as another visit. Linear in T, in nodes, and in pairs of nodes at one place.
    """
    nodes = list(graph.nodes.values())
    if len(nodes) < 2:
        return ()
    places = np.array([node.odometry for node in nodes])
    here = poses[-1] if len(poses) else places[0]
    driven = _driven_m(np.array([node.id for node in nodes]), np.asarray(steps), np.asarray(poses))
    found: list[tuple[float, int, int]] = []
    for k, others in _at_one_place(places):
        gaps = np.hypot(*(places[others] - places[k])[:, :2].T)
        turned = np.abs(wrap_angle(places[others, 2] - places[k, 2]))
        twice = (gaps < _SAME_PLACE_M) & (turned < _NEAR_RAD) & ~(np.abs(driven[others] - driven[k]) < _AWAY_M)
        if twice.any():
            close = _reached(graph, nodes[k].id)
            chosen = zip(gaps[twice], others[twice], strict=True)
            found += [(float(gap), k, int(j)) for gap, j in chosen if nodes[j].id not in close]
    loops = [((nodes[k].id, nodes[j].id), gap) for gap, k, j in _thinned(sorted(found), places)]
    loops.sort(key=lambda loop: _apart(here, graph.nodes[loop[0][0]].odometry))
    return tuple(_unclosed(graph, here, edge, gap_m) for edge, gap_m in loops)


def _unclosed(graph: TopologicalGraph, here: Pose, edge: EdgeKey, gap_m: float) -> MapFinding:
    target = graph.nodes[edge[0]].odometry
    text = f"Nodes {edge[0]} and {edge[1]} are the same place on two visits, but no edge joins them."
    return _found(text, f"Drive through it again, {_way(here, target)}.", target)._replace(pairs=((edge, gap_m),))


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
    for k, (x, y) in enumerate(np.floor(places[:, :2] / _SAME_PLACE_M).astype(int).tolist()):
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
        if all(np.hypot(*(here - other)) > 2 * _SAME_PLACE_M for other in kept):
            kept.append(here)
            yield gap, k, j


def _view(here: Pose, current: Matches | None) -> Iterator[MapFinding]:
    """Yield how new the present view is: 1 - best r of any node."""
    if current is None:
        return
    known = float(np.max(current.reachability, initial=0.0))
    text = f"This view is {1 - known:.0%} new."
    if known > _KNOWN:
        yield _found(text)
        return
    ahead = pose_row(here + np.array([_AHEAD_M * np.cos(here[2]), _AHEAD_M * np.sin(here[2]), 0.0]))
    yield _found(text, "Continue slowly, so that the next images join it to the map.", ahead)


def one_sided_places(poses: Pose) -> tuple[MapFinding, ...]:
    """Return the places, squares of 1 m, where all odometry `poses` (T, 3) look to the same side; the place nearest to
    the last pose comes first. The target is the mean pose, turned round. Linear in T."""
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    cells = np.floor(poses[:, :2] / _CELL_M).astype(np.int64)
    _, owner, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sector = np.round(poses[:, 2] / (2 * np.pi / _HEADING_SECTORS)).astype(np.int64) % _HEADING_SECTORS
    histograms = np.bincount(
        owner.ravel() * _HEADING_SECTORS + sector, minlength=len(counts) * _HEADING_SECTORS
    ).reshape(-1, _HEADING_SECTORS)
    weights = (poses[:, 0], poses[:, 1], np.cos(poses[:, 2]), np.sin(poses[:, 2]))
    sums = [np.bincount(owner.ravel(), each, len(counts)) for each in weights]
    seen = histograms > 0
    apart = range(_OPPOSITE, _HEADING_SECTORS - _OPPOSITE + 1)
    other_sides = np.any([seen & np.roll(seen, shift, axis=1) for shift in apart], axis=(0, 2))
    targets = []
    for k in np.flatnonzero((counts >= _MIN_IMAGES) & ~other_sides):
        x, y, cos, sin = (float(each[k]) for each in sums)
        targets.append(PoseRow(x / counts[k], y / counts[k], float(wrap_angle(math.atan2(sin, cos) + math.pi))))
    targets.sort(key=lambda target: _apart(poses[-1], target))
    text = "One place was seen from one side only."
    return tuple(_found(text, f"Look the other way there, {_way(poses[-1], each)}.", each) for each in targets)


def contradicted_edges(graph: TopologicalGraph) -> tuple[MapFinding, ...]:
    """Return the edges that odometry contradicts much more than the other edges of the map, the worst first; linear.

    In a map of several drives with independent odometry, many edges disagree, and none of them stands out.
    """
    edges = graph.driven_edges
    if not edges:
        return ()
    driven = relative(*(_odometry(graph, ends) for ends in zip(*edges, strict=True)))
    claimed = np.array([edge.waypoint for edge in edges.values()], np.float64)
    gaps_m = np.hypot(*(driven - claimed)[:, :2].T)
    limit_m = max(_LEAST_GAP_M, _TIMES_USUAL * float(np.quantile(gaps_m, _USUAL_QUANTILE)))
    found, keys = [], [*edges]
    for row in np.argsort(-gaps_m, kind="stable"):
        if gaps_m[row] <= limit_m:
            break
        (source, target), apart_m = keys[row], float(np.hypot(*driven[row, :2]))
        claimed_m = np.hypot(*claimed[row, :2])
        text = f"An edge is {claimed_m:.2f} m long, but by odometry its ends are {apart_m:.2f} m apart."
        remedy = "They may be two places that look alike: if so, cut it."
        found.append(_found(text, remedy)._replace(pairs=(((source, target), apart_m),)))
    return tuple(found)


def map_gap(graph: TopologicalGraph, start: NodeId, goal: NodeId) -> MapFinding | None:
    """Return the gap between two nodes, with the nearest pairs across it; None if there is a path, or if a node is
    missing.

    Linear in the edges, plus one nearest-neighbour search for each node that can be reached.
    """
    if start not in graph.nodes or goal not in graph.nodes:
        return None
    mirror, index = mirrored(graph, graph.edges)
    reached = [start, *(mirror[k] for k in sorted(rustworkx.descendants(mirror, index[start])))]
    if goal in reached:
        return None
    leading = [goal, *(mirror[k] for k in sorted(rustworkx.ancestors(mirror, index[goal])))]
    pairs = _nearest(graph, reached, leading)
    text = (
        f"The first map has a gap: paths lead from node {start} to {len(reached)} nodes, and from {len(leading)} other "
        f"nodes to node {goal}.{' The nearest across it, with d by odometry:' * bool(pairs)}"
    )
    return _found(text)._replace(pairs=pairs)


def _nearest(
    graph: TopologicalGraph, reached: Sequence[NodeId], leading: Sequence[NodeId]
) -> tuple[tuple[EdgeKey, float], ...]:
    """Return the nearest pairs with d by odometry, the nearest first; none if odometry never moves."""
    here = _odometry(graph, reached)
    there = _odometry(graph, leading)
    if not np.ptp(np.concatenate([here, there])[:, :2], axis=0).any():
        return ()
    count = min(_NEIGHBOURS, len(leading))
    # With one neighbour, the search returns (N,).
    beyond = np.asarray(KDTree(there[:, :2]).query(here[:, :2], k=count)[1]).reshape(-1, count)
    gaps = distance(relative(here[:, None], there[beyond]))
    pairs = [
        ((reached[row], leading[column]), float(gap))
        for row, columns in enumerate(beyond.tolist())
        for column, gap in zip(columns, gaps[row], strict=True)
    ]
    return tuple(sorted(pairs, key=lambda pair: pair[1])[:_NEAREST])


def _odometry(graph: TopologicalGraph, nodes: Sequence[NodeId]) -> Pose:
    """Return the poses (N, 3) of the nodes by odometry."""
    return np.array([graph.nodes[node].odometry for node in nodes], np.float64).reshape(-1, 3)


def _rim(poses: Pose, text: str) -> MapFinding:
    """Return `text` and the way to the edge of the driven area, where something new is most likely."""
    middle = poses[:, :2].mean(axis=0)
    rim = poses[int(np.argmax(np.hypot(*(poses[:, :2] - middle).T)))]
    target = PoseRow(float(rim[0]), float(rim[1]), float(np.arctan2(*(rim[:2] - middle)[::-1])))
    return _found(text, f"Drive beyond what you have seen, {_way(poses[-1], target)}.", target)


def _apart(here: Pose, place: PoseRow) -> float:
    return math.hypot(place.x_m - here[0], place.y_m - here[1])


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
