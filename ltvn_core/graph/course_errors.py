"""How well the corrected odometry knows where two images lie, judged by the edges between recognised images.

Odometry drifts with the distance driven; where recognised images follow a longer way, they show how much. Where they
say another relative pose than odometry, odometry relates the two passes wrongly, and nothing there may rest on it. Owns
this error model.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId

_USUAL_M, _USUAL_RAD = 0.033, 0.013
"""Usual standard deviation of corrected odometry after one metre, along each axis in m, and in rad; for drives that do
not show their own. It grows with the square root of the distance driven, as measured in `tune-hall-0` and
`tune-tables-0`."""
_LEAST_M, _LEAST_RAD = 0.015, 0.006
"""Least such errors: the images of a drive show no smaller ones."""
_COMPARED_M = 4.0
"""Least distance driven between recognised images that shows the drift, in metres."""
_LEAST_COMPARED = 12
"""Least number of pairs of recognised images that show the drift of a drive."""
_PLANE_MEDIAN, _MEDIAN = 1.177, 0.6745
"""Median distance of errors in the plane, and median size of errors along one axis, in standard deviations."""
_KNOWN_M, _KNOWN_RAD = 0.25, np.deg2rad(10.0)
"""Greatest standard deviation up to which a relative pose is known, in m and rad."""
_SAME_PASS_M = 5.0
"""Distance along the drive within which images belong to one pass, in metres."""
_CONTRADICTS_M, _CONTRADICTS_RAD = 0.5, np.deg2rad(20.0)
"""Median disagreement of recognised images with odometry above which they contradict it, in m and rad; a single
waypoint errs by up to 0.6 m."""


class CourseErrors:
    """Errors of the corrected odometry in one map."""

    def __init__(self, graph: TopologicalGraph, gate: OdometryGate) -> None:
        """Compare the edges between recognised images with odometry."""
        self._gate = gate
        edges = [edge for edge in graph.driven_edges.values() if not edge.by_odometry]
        by_source: dict[NodeId, list[int]] = {}
        for k, edge in enumerate(edges):
            by_source.setdefault(edge.source, []).append(k)
        gaps, path_m = np.zeros((len(edges), 3)), np.full(len(edges), np.inf)
        waypoints = np.array([edge.waypoint for edge in edges]).reshape(-1, 3)
        ends = np.array([gate.rows([edge.source, edge.target]) for edge in edges], np.intp).reshape(-1, 2)
        for source, own in by_source.items():
            driven, path_m[own] = gate.seen_from(source, ends[own, 1])
            gaps[own] = relative(waypoints[own], driven)
        known = np.isfinite(path_m)
        self._off_m = np.hypot(gaps[known, 0], gaps[known, 1])
        self._off_rad = np.abs(wrap_angle(gaps[known, 2]))
        self._passes = KDTree(gate.along_m(ends[known].ravel()).reshape(-1, 2))
        self._growth_m = _growth(self._off_m, path_m[known], _PLANE_MEDIAN, (_USUAL_M, _LEAST_M))
        self._growth_rad = _growth(self._off_rad, path_m[known], _MEDIAN, (_USUAL_RAD, _LEAST_RAD))

    def error_m(self, path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviations (M,) of positions, in metres, after odometry paths of some lengths (M,)."""
        return self._growth_m * np.sqrt(path_m)

    def know(self, path_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell (M,) whether relative poses are known after odometry paths of some lengths (M,) in metres."""
        return (self.error_m(path_m) <= _KNOWN_M) & (self._growth_rad * np.sqrt(path_m) <= _KNOWN_RAD)

    def contradict(self, source: NodeId, target: NodeId) -> bool:
        """Tell whether the images around two nodes, along the drive, say another relative pose than odometry."""
        if not self._passes.n:
            return False
        passes = self._gate.along_m(self._gate.rows([source, target]))
        # Within a pass of their own, the images between the two nodes say nothing about both.
        reach_m = min(_SAME_PASS_M, float(np.ptp(passes)) / 3)
        near = self._passes.query_ball_point(passes, reach_m, p=np.inf)
        if not near:
            return False
        off_m, off_rad = np.median(self._off_m[near]), np.median(self._off_rad[near])
        return bool(off_m > _CONTRADICTS_M or off_rad > _CONTRADICTS_RAD)


def _growth(off: NDArray[np.float64], path_m: NDArray[np.float64], median: float, limits: tuple[float, float]) -> float:
    """Return the standard deviation after one metre that disagreements (N,) after paths (N,) show, beyond those without
    a path; `limits` are the usual and the least one, and `median` is that of a unit deviation."""
    long = path_m >= _COMPARED_M
    if long.sum() < _LEAST_COMPARED or long.all():
        return limits[0]
    at_once = np.median(off[~long])
    return max(limits[1], float(np.median(np.maximum(off[long] - at_once, 0.0) / np.sqrt(path_m[long]))) / median)
