"""The edges of a map against the ground truth: precision, recall, the calibration of p over attempts, and waypoints.

`ground_truth` decides which edges are drivable, and has the calibration of a whole map at one time.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from ltvn_core.analysis.map_history import MapReplay
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.planner import cost_matrix
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import AttemptEnded, StampedEvent
from ltvn_core.simulation.oracle_predictor import is_drivable
from ltvn_core.types import NodeId, Pose, Waypoint

DETOUR_RATIO = 3.0
"""Ratio of the path through the map to the straight line above which an edge is missing (ours)."""
MISPLACED_M, MISPLACED_RAD = 0.5, float(np.deg2rad(20))
"""Errors of a pose, in metres and radians, beyond which an edge leads elsewhere or an image is lost (ours)."""
_SEARCHES_PER_CALL = 256
"""Number of source nodes per call of the shortest-path search, which limits its memory."""


@dataclass(frozen=True, slots=True)
class MissingEdge:
    """Two nodes close to each other, with free floor between them, without a short path through the map."""

    source: NodeId
    target: NodeId
    distance: float
    """d of Eq. 2 between their exact poses."""
    path: float
    """Length of the cheapest path through the map, in the same unit; infinite without any."""


@dataclass(frozen=True, slots=True)
class EdgeAccuracy:
    """The spurious and missing edges of a map, with precision and recall."""

    spurious: frozenset[EdgeKey]
    """Edges that are not drivable."""
    missing: tuple[MissingEdge, ...]
    """Missing edges, the longest detours first."""
    neighbours: int
    """Number of directed pairs of close nodes that are drivable."""
    linked: int
    """Number of these pairs with an edge of their own."""
    precision: float | None
    """Share of edges that are drivable; None without edges."""
    recall: float | None
    """Share of neighbours with an edge or a short path; None without neighbours."""


def edge_accuracy(
    graph: TopologicalGraph, truth: GroundTruth, *, near: float, detour: float = DETOUR_RATIO
) -> EdgeAccuracy:
    """Compare a map with the ground truth; neighbours are closer than `near`, the method's D_c, by exact poses.

    Raises MapError if a node has no exact pose. Takes O(N) searches of the map around each node.
    """
    spurious = frozenset(truth.spurious(graph))
    edges = graph.edges
    pairs = tuple(_neighbours(graph, truth, near))
    apart = [pair for pair in pairs if (pair.source, pair.target) not in edges]
    missing = [pair for pair in _with_paths(graph, apart, detour * near) if pair.path > detour * pair.distance]
    return EdgeAccuracy(
        spurious=spurious,
        missing=tuple(sorted(missing, key=lambda pair: (-pair.path, pair.distance))),
        neighbours=len(pairs),
        linked=len(pairs) - len(apart),
        precision=1 - len(spurious) / len(edges) if edges else None,
        recall=1 - len(missing) / len(pairs) if pairs else None,
    )


def waypoint_errors(edges: Collection[Edge], poses: Mapping[NodeId, Pose]) -> Waypoint:
    """Return the true poses (E, 3) of the ends of edges, seen from where their waypoints say; `poses` are true."""
    rows = [(edge.waypoint, relative(poses[edge.source], poses[edge.target])) for edge in edges]
    claimed, truly = np.array(rows, float).reshape(-1, 2, 3).swapaxes(0, 1)
    return relative(claimed, truly)


def misplaced(errors: Waypoint) -> NDArray[np.bool_]:
    """Return which of N errors (N, 3) of poses are too large."""
    return (np.hypot(errors[:, 0], errors[:, 1]) > MISPLACED_M) | (np.abs(errors[:, 2]) > MISPLACED_RAD)


def _neighbours(graph: TopologicalGraph, truth: GroundTruth, near: float) -> Iterator[MissingEdge]:
    """Yield the directed pairs that an edge could join, still without the length of their path."""
    nodes = list(graph.nodes)
    poses = truth.poses(nodes)
    first, second = _near_pairs(poses, near)
    gaps = distance(relative(poses[first], poses[second]))
    drivable = is_drivable(truth.clearance, poses[first], poses[second])
    for k in np.flatnonzero((gaps < near) & drivable).tolist():
        yield MissingEdge(source=nodes[first[k]], target=nodes[second[k]], distance=float(gaps[k]), path=np.inf)


def _near_pairs(poses: Pose, near: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    if not len(poses):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    # d (Eq. 2) is at least the distance in the plane, so a radius search in the plane finds all neighbours.
    pairs = KDTree(poses[:, :2]).query_pairs(near, output_type="ndarray")
    return np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]])


def _with_paths(graph: TopologicalGraph, pairs: Sequence[MissingEdge], limit: float) -> Iterator[MissingEdge]:
    """Yield the pairs with the length of the path between them, infinite if it is longer than `limit`."""
    nodes, costs = cost_matrix(graph, lambda belief: belief.mu)
    row = {node: k for k, node in enumerate(nodes)}
    sources = list(dict.fromkeys(pair.source for pair in pairs))
    by_source: dict[NodeId, list[MissingEdge]] = {source: [] for source in sources}
    for pair in pairs:
        by_source[pair.source].append(pair)
    for begin in range(0, len(sources), _SEARCHES_PER_CALL):
        part = sources[begin : begin + _SEARCHES_PER_CALL]
        lengths = dijkstra(costs, indices=[row[source] for source in part], limit=limit)
        for k, source in enumerate(part):
            for pair in by_source[source]:
                yield MissingEdge(
                    source=source, target=pair.target, distance=pair.distance, path=float(lengths[k, row[pair.target]])
                )


class CalibrationAttempt(NamedTuple):
    """One attempt at an edge: its p before, the outcome by the robot's own criterion, and the true outcome."""

    instant: Instant
    """Time at the end of the attempt."""
    query: int
    edge: EdgeKey
    p: float
    """p of the edge before the attempt."""
    succeeded: bool
    """Whether it succeeded by the robot's own judgement."""
    arrived: bool | None
    """Whether it arrived by exact poses and the paper's criterion; None if the arrival image has no pose."""

    @property
    def drivable(self) -> bool:
        """Whether the robot arrived, by exact poses if they are known, else by its own criterion."""
        return self.succeeded if self.arrived is None else self.arrived


@dataclass(frozen=True, slots=True, kw_only=True)
class AttemptCalibration:
    """Calibration of p over attempts: p before them, and their results."""

    attempts: int
    mean_p: float
    """Mean p before the attempts."""
    succeeded: float
    """Share of attempts that succeeded by the robot's own judgement."""
    arrived: float | None
    """Share of attempts that truly arrived; None if unknown."""
    brier: float
    """Mean square of p minus true arrival (or minus the robot's judgement if arrival is unknown); 0 is best."""


def calibration_attempts(
    events: Sequence[StampedEvent], truth: GroundTruth | None = None
) -> tuple[CalibrationAttempt, ...]:
    """Return all attempts at edges that the map had at that time, in order; linear in events."""
    return tuple(_attempts(events, truth))


def attempt_calibration(attempts: Sequence[CalibrationAttempt]) -> AttemptCalibration | None:
    """Return the calibration of p over attempts; None without any."""
    count = len(attempts)
    if not count:
        return None
    known = [each.arrived for each in attempts if each.arrived is not None]
    return AttemptCalibration(
        attempts=count,
        mean_p=sum(each.p for each in attempts) / count,
        succeeded=sum(each.succeeded for each in attempts) / count,
        arrived=sum(known) / len(known) if known else None,
        brier=sum((each.p - each.drivable) ** 2 for each in attempts) / count,
    )


def _attempts(events: Sequence[StampedEvent], truth: GroundTruth | None) -> Iterator[CalibrationAttempt]:
    timeline = Timeline.of(events)
    folding = MapReplay()
    changes = {change.event: change for change in timeline.changes}
    for index, stamped in enumerate(timeline.events):
        event = stamped.event
        if index in changes:
            folding.take(changes[index])
        elif isinstance(event, AttemptEnded) and event.source is not None:
            edge = folding.graph.edges.get((event.source, event.target))
            if edge is not None:
                yield CalibrationAttempt(
                    instant=Instant(stamped.step, stamped.stamp),
                    query=event.query,
                    edge=(event.source, event.target),
                    p=edge.belief.p,
                    succeeded=event.succeeded,
                    arrived=_arrived(truth, event),
                )


def _arrived(truth: GroundTruth | None, attempt: AttemptEnded) -> bool | None:
    if truth is None or not (truth.knows(attempt.frame) and truth.knows(attempt.target)):
        return None
    return judge_goal_reached(attempt.query, truth.pose(attempt.frame), truth.pose(attempt.target)).reached
