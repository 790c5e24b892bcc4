"""Groups lifelong results by scene and method, over all map seeds, and sums over intervals of queries."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ltvn_core.evaluation.results import EdgeCalibrationBin, LifelongPoint, LifelongResult
from ltvn_core.reports.result_rows import ResultRow, setup_of


@dataclass(frozen=True)
class LifelongGroup:
    """Queries with maintenance in one scene by one method, each run from a map of its own."""

    scene: str
    method: str
    """Label of the method."""
    runs: tuple[LifelongResult, ...]
    """One result for each map seed."""

    def points(self) -> tuple[ResultRow, ...]:
        """Return the tests in between as rows, by the number of queries before them."""
        found: dict[int, list[LifelongPoint]] = {}
        for run in self.runs:
            for point in run.points:
                found.setdefault(point.queries, []).append(point)
        return tuple(
            ResultRow(setup_of(points[0].trial), tuple(point.trial for point in points))
            for _, points in sorted(found.items())
        )


@dataclass(frozen=True, slots=True)
class MaintenanceInterval:
    """Changes of the map by the queries between two tests, mean over the runs."""

    first: int
    until: int
    """Number of queries at the test before and at the one after."""
    pruned: float
    pruned_bad: float
    """Pruned edges that are spurious or that the robot could not drive."""
    added_edges: float
    added_spurious: float
    """Added edges that are spurious."""


def group_lifelong(results: Iterable[LifelongResult]) -> tuple[LifelongGroup, ...]:
    """Group results by scene, then method. A result without points is left out."""
    groups: dict[tuple[str, str], list[LifelongResult]] = {}
    for result in results:
        if result.points:
            setup = setup_of(result.points[0].trial)
            method = setup.method
            method += f", {result.maintenance} maintenance" if result.maintenance else ""
            groups.setdefault((setup.scene, method), []).append(result)
    return tuple(
        LifelongGroup(scene, method, tuple(sorted(runs, key=lambda run: run.seed)))
        for (scene, method), runs in sorted(groups.items())
    )


def maintenance_intervals(group: LifelongGroup) -> tuple[MaintenanceInterval, ...]:
    """Return the changes by maintenance from each test to the next."""
    tests = sorted({point.queries for run in group.runs for point in run.points})
    return tuple(_interval(group, first, until) for first, until in pairwise(tests))


def end_points(lifelong_groups: Sequence[LifelongGroup], *, last: bool) -> list[LifelongPoint]:
    """Return the first or the last test of each run."""
    return [run.points[-1 if last else 0] for group in lifelong_groups for run in group.runs]


def calibration_of(points: Iterable[LifelongPoint]) -> tuple[EdgeCalibrationBin, ...]:
    """Add up the calibration of p over several tests, empty cells left out."""
    found: dict[tuple[float, float], list[EdgeCalibrationBin]] = {}
    for point in points:
        for cell in point.calibration:
            found.setdefault((cell.low, cell.high), []).append(cell)
    return tuple(_added_up(cells) for _, cells in sorted(found.items()) if sum(cell.edges for cell in cells))


def calibration_error(cells: Sequence[EdgeCalibrationBin]) -> float:
    """Return the mean difference between p and the share of drivable edges; nan without edges."""
    total = sum(cell.edges for cell in cells)
    gaps = sum(cell.edges * abs(cell.mean_p - cell.drivable) for cell in cells)
    return gaps / total if total else float("nan")


def _interval(group: LifelongGroup, first: int, until: int) -> MaintenanceInterval:
    runs = [run for run in group.runs if len(run.queries) >= until]
    queries = [query for run in runs for query in run.queries[first:until]]

    def mean(name: str) -> float:
        return sum(getattr(query, name) for query in queries) / max(len(runs), 1)

    return MaintenanceInterval(
        first=first,
        until=until,
        pruned=mean("pruned"),
        pruned_bad=mean("pruned_bad"),
        added_edges=mean("added_edges"),
        added_spurious=mean("added_spurious"),
    )


def _added_up(cells: Sequence[EdgeCalibrationBin]) -> EdgeCalibrationBin:
    edges = sum(cell.edges for cell in cells)
    mean_p = sum(cell.edges * cell.mean_p for cell in cells) / edges
    drivable = sum(cell.edges * cell.drivable for cell in cells) / edges
    return EdgeCalibrationBin(low=cells[0].low, high=cells[0].high, edges=edges, mean_p=mean_p, drivable=drivable)
