"""What a map lacks: loops that were driven but not closed, and places seen from one side only.

Owns finding these from a graph and from odometry. Which of them to mend first is `analysis.mapping_advice`.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Pose

SAME_PLACE_M = 0.8
"""Nodes nearer than this by odometry are the same place."""
_NEAR_RAD = 0.5
"""Nodes turned by less than this look at the same things."""
_AWAY_M = 3.0
"""Driven between two visits, at least, so that they are two."""
_HOPS = 6
"""Nodes joined by so few edges are joined well enough."""
_JUMP_M = 1.5
"""Two poses in a row that are farther apart were not driven from one to the other."""
_CELL_M = 1.0
HEADING_SECTORS = 8
"""Of 45 degrees, centred on the axes and the diagonals."""
_OPPOSITE = 3
"""Sectors apart, at least, that count as another side."""
_MIN_IMAGES = 3
"""A place with fewer images is not yet a place."""


@dataclass(frozen=True, slots=True)
class MissingLoopClosure:
    """Two nodes at one place, from two visits, that no edge joins and no short path either."""

    first: NodeId
    second: NodeId
    gap_m: float
    """Between the two by odometry, which drifts: the loop is a guess."""


@dataclass(frozen=True, slots=True, eq=False)
class OneSidedPlace:
    """A place where the camera always looked to the same side."""

    x_m: float
    y_m: float
    """Mean of the poses there."""
    yaw_rad: float
    """Mean heading."""
    images: int
    """Taken there."""


def find_missing_loop_closures(
    graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose
) -> tuple[MissingLoopClosure, ...]:
    """Return where the drive came back and no edge, nor a few of them, lead across; one per place, the closest pair.

    `steps` (T,) and odometry `poses` (T, 3) are the drive so far, ascending. Nodes that were not on it belong to
    another visit. Linear in T, in nodes, and in pairs of nodes at one place.
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
    """Return the places, squares of 1 m, where odometry `poses` (T, 3) never look to another side. Linear in T."""
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    cells = np.floor(poses[:, :2] / _CELL_M).astype(np.int64)
    _, owner, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sector = np.round(poses[:, 2] / (2 * np.pi / HEADING_SECTORS)).astype(np.int64) % HEADING_SECTORS
    histograms = np.bincount(owner.ravel() * HEADING_SECTORS + sector, minlength=len(counts) * HEADING_SECTORS).reshape(
        -1, HEADING_SECTORS
    )
    sums = [np.bincount(owner.ravel(), weights, len(counts)) for weights in _weights(poses)]
    found = []
    for k in np.flatnonzero((counts >= _MIN_IMAGES) & ~_other_sides(histograms > 0)):
        x, y, cos, sin = (float(each[k]) for each in sums)
        count = int(counts[k])
        found.append(OneSidedPlace(x_m=x / count, y_m=y / count, yaw_rad=float(np.arctan2(sin, cos)), images=count))
    return tuple(found)


def _weights(poses: Pose) -> tuple[NDArray[np.float64], ...]:
    return poses[:, 0], poses[:, 1], np.cos(poses[:, 2]), np.sin(poses[:, 2])


def _other_sides(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell (C,) whether any two sectors of (C, 8) that were seen lie on different sides."""
    apart = range(_OPPOSITE, HEADING_SECTORS - _OPPOSITE + 1)
    return np.any([seen & np.roll(seen, shift, axis=1) for shift in apart], axis=(0, 2))


def _driven_m(nodes: NDArray[np.int64], steps: NDArray[np.int64], poses: Pose) -> NDArray[np.float64]:
    """Return (N,) metres driven up to each node, nan where it is not on the drive or odometry jumped in between."""
    if not len(steps):
        return np.full(len(nodes), np.nan)
    moves = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    # A jump counts as a long drive: what lies before and after it are two visits.
    path = np.concatenate([[0.0], np.cumsum(np.where(moves > _JUMP_M, 1e6, moves))])
    row = np.clip(np.searchsorted(steps, nodes), 0, len(steps) - 1)
    return np.where(steps[row] == nodes, path[row], np.nan)


def _at_one_place(places: Pose) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield each row of (N, 3) with the earlier ones in its square and the eight around."""
    squares: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (x, y) in enumerate(np.floor(places[:, :2] / SAME_PLACE_M).astype(int).tolist()):
        around = itertools.product((x - 1, x, x + 1), (y - 1, y, y + 1))
        others = [j for square in around if square in squares for j in squares[square]]
        squares[x, y].append(k)
        if others:
            yield k, np.array(others, np.intp)


def _reached(graph: TopologicalGraph, start: NodeId) -> set[NodeId]:
    """Return the nodes that a few edges, either way, lead to."""
    reached, frontier = {start}, [start]
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
