"""Prints how well the drives of one map were joined, by the true poses of their images, as a Markdown table.

ltvn build monday.rrd tuesday.rrd --output map.rrd
python -m tools.joint_table map.rrd

The true poses of all drives must be in one frame.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from tyro.conf import Positional

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.errors import MapError
from ltvn_core.evaluation.reports.evaluation_tables import ReportTable
from ltvn_core.geometry import compose, invert, relative
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose

_HEAD = ("drive", "nodes", "joined at", "waypoints off by", "largest", "lies off by")


@dataclass(frozen=True, kw_only=True)
class JointTable:
    """Judge the joints of a map of several drives."""

    map: Positional[Path]
    """The map."""
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the true poses of the later drives begin, x, y in m and yaw in rad, if they were moved to zero before."""

    def run(self) -> ReportTable:
        """Return a table with a row for each drive after the first; raises MapError without drives or true poses."""
        loaded = load_map(self.map)
        graph = loaded.graph
        if len(graph.drives) < 2:
            raise MapError(f"{self.map} is a map of one drive; name one that `ltvn build A.rrd B.rrd` made.")
        truth = dict[NodeId, Pose]()
        for node in graph.nodes:
            exact = loaded.observations[node].exact_pose
            if exact is None:
                raise MapError(f"{self.map}: nobody knows where node {node} is; name a map of drives with true poses.")
            truth[node] = exact if graph.drive_of(node) == 1 else compose(np.array(self.moved), exact)
        rows = (_row(graph, truth, number, name) for number, name in enumerate(graph.drives.values(), 1) if number > 1)
        return ReportTable(caption="", head=_HEAD, rows=tuple(rows), words=1)


def _row(graph: TopologicalGraph, truth: Mapping[NodeId, Pose], number: int, name: str) -> tuple[str, ...]:
    own = [node for node in graph.nodes if graph.drive_of(node) == number]
    crossing = [
        edge for edge in graph.edges if max(map(graph.drive_of, edge)) == number > min(map(graph.drive_of, edge))
    ]
    places = {frozenset(edge) for edge in crossing}
    found = np.array([graph.edges[edge].waypoint for edge in crossing]).reshape(-1, 3)
    real = np.array([relative(truth[a], truth[b]) for a, b in crossing]).reshape(-1, 3)
    lie = np.array([compose(_frame(graph, truth), np.array(graph.nodes[node].odometry)) for node in own]).reshape(-1, 3)
    there = np.array([truth[node] for node in own]).reshape(-1, 3)
    off, apart = _errors(found, real), _errors(lie, there)
    if not crossing:
        return name, str(len(own)), "0 places", "–", "–", "–"
    return name, str(len(own)), f"{len(places)} places", *(_cell(each) for each in (*off, apart[0]))


def _frame(graph: TopologicalGraph, truth: Mapping[NodeId, Pose]) -> Pose:
    """Return where the map's frame begins in truth, (3,), as the first node of the first drive says."""
    first = next(node for node in graph.nodes if graph.drive_of(node) == 1)
    return compose(truth[first], invert(np.array(graph.nodes[first].odometry)))


def _errors(found: Pose, real: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the median and the largest difference of poses (N, 3), each in m and degrees."""
    if not len(found):
        return np.zeros(2), np.zeros(2)
    turned = np.degrees(np.abs((found[:, 2] - real[:, 2] + np.pi) % (2 * np.pi) - np.pi))
    errors = np.stack([np.hypot(*(found - real)[:, :2].T), turned], axis=1)
    return np.median(errors, axis=0), errors.max(axis=0)


def _cell(error: NDArray[np.float64]) -> str:
    return f"{error[0]:.3f} m, {error[1]:.1f}°"


def main() -> None:
    """Print the table."""
    sys.stdout.write(tyro.cli(JointTable).run().markdown() + "\n")


if __name__ == "__main__":
    main()
