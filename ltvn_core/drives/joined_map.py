"""A map that was built from several drives, made whole: where drives begin, what they contradict, and where they lie.

Owns the order of these steps. How drives are joined while the map is built is `graph.drive_links`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ltvn_core.drives.drive_alignment import drive_movements, moved_graph, moved_keyframes
from ltvn_core.drives.drive_contradictions import DriveContradictions
from ltvn_core.drives.drive_report import DriveReport, report_drive
from ltvn_core.drives.joined_drives import JoinedDrive
from ltvn_core.graph.deltas import Cause, DriveBegun
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation, Predictor


class JoinedMap(NamedTuple):
    """A map of several drives."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    reports: tuple[DriveReport, ...]


def join_map(
    graph: TopologicalGraph,
    keyframes: KeyframeStore,
    observations: Sequence[Observation],
    drives: Sequence[JoinedDrive],
    predictor: Predictor,
    system: NavigationSystem,
) -> JoinedMap:
    """Return the map that was built from `observations`, as the predictor sees them, with what it must know of drives.

    Each drive after the first is compared with those before it; see `DriveContradictions.compare` for the cost.
    """
    for drive in drives:
        graph.apply(DriveBegun(drive.first, drive.name, Cause.BUILD))
    contradictions = DriveContradictions(graph, keyframes, predictor, system)
    reports = [report_drive(graph, drives[0], None)]
    for drive in drives[1:]:
        own = sorted((seen for seen in observations if drive.holds(seen.step)), key=lambda seen: seen.step)
        comparison = contradictions.compare(own, drive)
        for delta in comparison.observed:
            graph.apply(delta)
        reports.append(report_drive(graph, drive, comparison))
    movements = drive_movements(graph, drives)
    moved = moved_keyframes(keyframes, predictor, drives, movements)
    return JoinedMap(moved_graph(graph, moved), moved, tuple(reports))
