"""Groups trials into rows, one for each scene, method and stage, and lifelong results by scene and method.

A row or group holds all map seeds. Owns the grouping, the order of rows and the display names of methods. Draws and
writes nothing.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import PurePath
from typing import TypeVar

from ltvn_core.evaluation.confidence_intervals import Estimate
from ltvn_core.evaluation.metrics import EvaluationMetrics, compute_metrics
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.results import OWN_MAINTENANCE, EdgeCalibrationBin, Run, TestedMap
from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES
from ltvn_core.systems.registry import known_system, system_names

ALL_SCENES = "all scenes"
"""Scene name of a row over all scenes."""

_Item = TypeVar("_Item")
_Key = TypeVar("_Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class TrialSetup:
    """The settings that all trials of one row share."""

    scene: str
    """The scene, followed by a comma and any conditions that were harder than usual."""
    system: str
    """Name of the navigation system in the registry."""
    preset: str
    method: str
    """Label of the method: `LTVN robust`, `SPTM`, `LTVN robust without pruning`."""
    finetuned: bool
    queries: int
    """Number of queries with maintenance before the episodes."""
    ablated: bool
    """Whether parts of the method were switched off or replaced by ground truth, or camera images were degraded."""

    @property
    def stage(self) -> str:
        """Stage of the map and the network: fine-tuning, and queries before the episodes."""
        tuned = "fine-tuned" if self.finetuned else "as trained"
        return f"{tuned}, {self.queries:,} queries" if self.queries else tuned


@dataclass(frozen=True, slots=True)
class MaintenanceInterval:
    """Changes of the map by the queries between two tests, mean over the runs."""

    first: int
    until: int
    """Numbers of queries before the first test and before the second test."""
    pruned: float
    pruned_bad: float
    """Mean number of pruned edges that are spurious or that the robot could not drive."""
    added_edges: float
    added_spurious: float
    """Mean number of added edges that are spurious."""


@dataclass(frozen=True)
class ResultRow:
    """All trials of one setup."""

    setup: TrialSetup
    trials: tuple[TestedMap, ...]
    """Trials, one for each map seed; in a row over all scenes, one for each scene and seed."""
    change: MaintenanceInterval | None = None
    """Changes of the map since the previous test of a lifelong group."""

    @cached_property
    def metrics(self) -> EvaluationMetrics:
        """Metrics over the trials."""
        return compute_metrics(self.trials)

    @property
    def success(self) -> Estimate:
        """Share of the episodes whose goal was reached."""
        return self.metrics.success_rate

    @property
    def seeds(self) -> tuple[int, ...]:
        """Map seeds."""
        return tuple(sorted({trial.columns.seed for trial in self.trials}))

    @property
    def scenes(self) -> set[str]:
        """Scenes of the trials, without conditions."""
        return {trial.columns.scene for trial in self.trials}

    def failed(self, cause: FailureCause) -> float:
        """Return the share of the episodes that failed for a cause."""
        return self.metrics.failures[cause.value] / self.metrics.episodes


def setup_of(trial: TestedMap) -> TrialSetup:
    """Return the settings that a trial shares with the others of its row."""
    # Fine-tuning is a stage of every method, so it is not part of the method's name.
    columns = trial.columns
    without = [part for part in columns.without if not part.replace("-", "").startswith("finetun")]
    system = known_system(columns.method)
    name = columns.method if system is None else system.label
    if system is not None and system.preset_in_label:
        name = f"{name} {columns.preset}"
    elif columns.preset != "robust":
        name = f"{name}, {columns.preset} navigator"
    if without:
        name = f"{name} without {', '.join(without)}"
    if asked_the_truth := columns.predictor == "oracle":
        name = f"{name} with the oracle"
    if columns.perturbations:
        name = f"{name}, camera with {', '.join(columns.perturbations)}"
    return TrialSetup(
        scene=_under(columns.scene, trial),
        system=columns.method,
        preset=columns.preset,
        method=name,
        finetuned=columns.finetuned,
        queries=trial.after,
        ablated=bool(without or columns.perturbations) or asked_the_truth,
    )


def _under(place: str, trial: TestedMap) -> str:
    """Return the name of a scene, or of all scenes, with the conditions of a trial."""
    return ", ".join([place, *trial.columns.conditions])


def scene_name(scene: str) -> str:
    """Return the display name of a scene: for a path, its last part."""
    return PurePath(scene).name or scene


def order_of(setup: TrialSetup) -> tuple[object, ...]:
    """Return the sort key of a row: scene, then method, then stage."""
    return (setup.scene, *_method_order(setup), setup.finetuned, setup.queries)


def static_tests(runs: Iterable[Run]) -> tuple[TestedMap, ...]:
    """Return the maps that no query may change, with their episodes."""
    return tuple(known for run in runs if run.columns.maintenance is None for known in run.maps)


def rows_of(runs: Iterable[Run]) -> tuple[ResultRow, ...]:
    """Group static tests into rows, by scene, then method, then stage."""
    return _gathered(static_tests(runs), setup_of)


def rows_over_scenes(rows: Sequence[ResultRow]) -> tuple[ResultRow, ...]:
    """Group rows of the same method, stage and conditions over all scenes; skip groups that lack a scene."""
    trials = [trial for row in rows for trial in row.trials]
    place = partial(_under, ALL_SCENES)
    scenes = {name: {each.columns.scene for each in found} for name, found in grouped(trials, place).items()}
    whole = _gathered(trials, lambda trial: replace(setup_of(trial), scene=place(trial)))
    return tuple(row for row in whole if len(row.scenes) > 1 and row.scenes == scenes[row.setup.scene])


def methods_of(rows: Iterable[ResultRow]) -> tuple[str, ...]:
    """Return the methods of rows in their order."""
    return tuple(dict.fromkeys(row.setup.method for row in sorted(rows, key=lambda row: _method_order(row.setup))))


def scenes_of(rows: Iterable[ResultRow]) -> tuple[str, ...]:
    """Return the scenes of rows in their order."""
    return tuple(dict.fromkeys(row.setup.scene for row in rows))


def _gathered(trials: Iterable[TestedMap], key: Callable[[TestedMap], TrialSetup]) -> tuple[ResultRow, ...]:
    rows = [
        ResultRow(setup, tuple(sorted(found, key=lambda trial: trial.columns.seed)))
        for setup, found in grouped(trials, key).items()
    ]
    return tuple(sorted(rows, key=lambda row: order_of(row.setup)))


def grouped(items: Iterable[_Item], key: Callable[[_Item], _Key]) -> dict[_Key, list[_Item]]:
    """Return items by their key, keys and items in order of appearance."""
    groups: dict[_Key, list[_Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def _method_order(setup: TrialSetup) -> tuple[object, ...]:
    names = system_names()
    rank = names.index(setup.system) if setup.system in names else len(names)
    # Robust comes before paper, and complete methods before ablated ones.
    return rank, setup.ablated, setup.preset == "paper", setup.method


@dataclass(frozen=True)
class LifelongGroup:
    """Queries with maintenance in one scene by one method; each run starts from its own map."""

    scene: str
    method: str
    """Label of the method."""
    runs: tuple[Run, ...]
    """One result for each map seed."""

    def points(self) -> tuple[ResultRow, ...]:
        """Return the static tests of all runs as rows, by the number of queries before each test."""
        found = grouped((point for run in self.runs for point in run.maps), lambda point: point.after)
        changes = {change.until: change for change in maintenance_intervals(self)}
        return tuple(
            ResultRow(replace(setup_of(points[0]), method=self.method), tuple(points), changes.get(after))
            for after, points in sorted(found.items())
        )


def group_lifelong(results: Iterable[Run]) -> tuple[LifelongGroup, ...]:
    """Group the runs with maintenance in a scene that does not change by scene, then method."""
    changing = [run for run in results if run.queries and run.columns.world is None]
    return tuple(
        LifelongGroup(scene, method, tuple(sorted(runs, key=lambda run: run.columns.seed)))
        for (scene, method), runs in sorted(grouped(changing, _place_and_method).items())
    )


def _place_and_method(run: Run) -> tuple[str, str]:
    setup = setup_of(run.maps[0])
    maintenance = run.columns.maintenance
    return setup.scene, setup.method + (f", {maintenance} maintenance" if maintenance != OWN_MAINTENANCE else "")


def maintenance_intervals(group: LifelongGroup) -> tuple[MaintenanceInterval, ...]:
    """Return the changes by maintenance from each test to the next."""
    tests = sorted({point.after for run in group.runs for point in run.maps})
    return tuple(_interval(group, first, until) for first, until in pairwise(tests))


def end_points(lifelong_groups: Sequence[LifelongGroup], *, last: bool) -> list[TestedMap]:
    """Return the first or the last test of each run."""
    return [run.maps[-1 if last else 0] for group in lifelong_groups for run in group.runs]


def calibration_of(points: Iterable[TestedMap]) -> tuple[EdgeCalibrationBin, ...]:
    """Add up the calibration of p over several tests, without empty bins."""
    found = grouped((cell for point in points for cell in point.calibration), lambda cell: (cell.low, cell.high))
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


@dataclass(frozen=True)
class WorldRow:
    """The queries of one maintenance in a changing world, in one scene or in all of them."""

    world: str
    """Name of the world, and its number of days."""
    scene: str
    """Display name of the scene, or `ALL_SCENES`."""
    maintenance: str
    runs: tuple[Run, ...]
    """One run for each scene and map seed."""

    @cached_property
    def metrics(self) -> WorldMetrics:
        """Metrics over the runs."""
        return world_metrics(self.runs)

    @property
    def seeds(self) -> tuple[int, ...]:
        """Map seeds."""
        return tuple(sorted({run.columns.seed for run in self.runs}))


def world_rows(runs: Iterable[Run]) -> tuple[WorldRow, ...]:
    """Group runs in changing worlds by world, scene and maintenance; of several scenes, all together come first."""
    rows: list[WorldRow] = []
    for world, here in grouped(in_order_of_worlds(runs), world_name).items():
        scenes = grouped(here, lambda run: run.columns.scene)
        for scene, there in (({ALL_SCENES: here} if len(scenes) > 1 else {}) | scenes).items():
            by_maintenance = grouped(there, lambda run: run.columns.maintenance or "")
            rows += [WorldRow(world, scene_name(scene), name, tuple(each)) for name, each in by_maintenance.items()]
    return tuple(rows)


def in_order_of_worlds(runs: Iterable[Run]) -> list[Run]:
    """Return runs in changing worlds by world, maintenance, scene and seed."""
    order = {name: place for place, name in enumerate(MAINTENANCE_NAMES)}

    def key(run: Run) -> tuple[object, ...]:
        columns = run.columns
        return world_name(run), order.get(columns.maintenance or "", 99), columns.scene, columns.seed

    return sorted(runs, key=key)


def world_name(run: Run) -> str:
    """Return the name of a run's changing world, and its number of days."""
    return f"{run.columns.world}, {run.columns.days:g} days"
