"""Whether images and odometry of a drive have one scale: a wrong unit of depth makes all distances wrong by one factor.

Compares the waypoints of edges between recognised images with the recorded odometry. Owns this check and its limits.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ltvn_core.findings import Finding
from ltvn_core.geometry import relative
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation

_LEAST_M, _MOST_M = 0.3, 2.0
"""Distance by odometry of the ends of an edge that is compared, in metres."""
_MOST_DRIVEN_M = 10.0
"""Greatest distance driven between them, over which odometry hardly drifts, in metres."""
_LEAST_EDGES = 24
_OFF = 1.25
"""Least factor between the two scales that is told."""
_MOST_SPREAD = 0.3
"""Greatest distance between the quartiles of the ratios, in medians, up to which one factor explains them."""


def scale_findings(graph: TopologicalGraph, observations: Sequence[Observation]) -> Iterator[Finding]:
    """Yield the factor between distances by images and by odometry, if it is the same everywhere and not 1.

    `observations` are as they were recorded, in order.
    """
    row = {seen.step: k for k, seen in enumerate(observations)}
    edges = [
        edge
        for (source, target), edge in graph.driven_edges.items()
        if source < target and not edge.by_odometry and graph.drive_of(source) == graph.drive_of(target)
    ]
    edges = [edge for edge in edges if edge.source in row and edge.target in row]
    if len(edges) < _LEAST_EDGES:
        return
    poses = np.array([seen.odometry for seen in observations])
    path_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    ends = np.array([(row[edge.source], row[edge.target]) for edge in edges]).T
    driven_m = np.hypot(*relative(poses[ends[0]], poses[ends[1]])[:, :2].T)
    seen_m = np.hypot(*np.array([edge.waypoint[:2] for edge in edges]).T)
    between_m = np.abs(path_m[ends[0]] - path_m[ends[1]])
    compared = (driven_m >= _LEAST_M) & (driven_m <= _MOST_M) & (between_m < _MOST_DRIVEN_M)
    if compared.sum() < _LEAST_EDGES:
        return
    low, ratio, high = np.quantile(seen_m[compared] / driven_m[compared], [0.25, 0.5, 0.75])
    if high - low > _MOST_SPREAD * ratio or 1 / _OFF < ratio < _OFF:
        return
    yield Finding(
        f"Distances by images are {ratio:.2f} of those by odometry, in {compared.sum():,} edges (half of them "
        f"{low:.2f} to {high:.2f}): the unit of depth or the scale of odometry is wrong.",
        remedy=f"Measure one distance. If odometry is right, all depths must become {1 / ratio:.2f} times as large: "
        "import again with the right depth_scale in the camera.json of --camera. Else correct the odometry.",
    )
