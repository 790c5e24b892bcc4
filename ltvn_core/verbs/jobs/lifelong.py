"""`ltvn lifelong`: the paper's lifelong test, and the same test in a changing world."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from tqdm import tqdm

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.lifelong_evaluation import LifelongSchedule, run_lifelong
from ltvn_core.evaluation.metrics import LifelongMetrics, lifelong_metrics
from ltvn_core.evaluation.results import LifelongResult, WorldResult
from ltvn_core.evaluation.trial_plans import sole_evaluation
from ltvn_core.evaluation.workers import Part, workers
from ltvn_core.evaluation.worlds.world_evaluation import run_world_evaluation
from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.evaluation.worlds.world_plans import WorldPlan
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.jobs.evaluate import command, trial_plans
from ltvn_core.verbs.jobs.evaluation_progress import PartSummary, progress_on_bar
from ltvn_core.verbs.lifelong import LifelongVerb
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True)
class LifelongSummary:
    """Results of the lifelong tests of all scenes and seeds."""

    scenes: tuple[str, ...]
    preset: str
    without: tuple[str, ...]
    maintenance: str | None
    """Name of the maintenance; None for the system's own."""
    seeds: tuple[int, ...]
    every: int
    """Number of queries between two static tests."""
    episodes: int
    """Number of episodes of each static test."""
    all: LifelongMetrics
    by_scene: dict[str, LifelongMetrics]
    folder: Path
    """Folder of drives, weights, maps and results; a second call of the verb continues from them."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class WorldSummary(WorldMetrics):
    """Results of the queries in a changing world; the numbers are those of the first maintenance."""

    world: str
    days: float
    scenes: tuple[str, ...]
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    maintenance: str
    """The first maintenance of the command line."""
    by_maintenance: dict[str, WorldMetrics]
    """All numbers of each maintenance."""
    folder: Path
    wall_s: float


def run_lifelong_test(options: LifelongVerb) -> Summary:
    """Run all tests that have no result yet.

    Raises OptionError, SceneError, WeightsError, MapError, RecordingError, and WorldError.
    """
    if len({*options.maintenance}) < len(options.maintenance):
        raise OptionError("--maintenance has a name twice.")
    if options.world is not None and options.conditions:
        raise OptionError("A --world already changes light and doors; omit --conditions or --world.")
    if options.world is not None:
        return _in_world(options, options.world)
    if len(options.maintenance) > 1 or {"truth", "brm-rooms"} & {*options.maintenance}:
        raise OptionError(
            "Without --world, --maintenance takes one name, and not truth or brm-rooms, which need a simulated world. "
            "Name a --world, or run the command once for each."
        )
    return _without_world(options, options.maintenance[0] if options.maintenance else None)


def _in_world(options: LifelongVerb, world: str) -> Summary:
    started = time.monotonic()
    trials = trial_plans(options, DEFAULT_SYSTEM, options.episodes)
    plans = [
        WorldPlan(trial=trial, world=world, maintenance=name, queries=options.queries, days=options.days)
        for name in options.maintenance or (options.preset,)
        for trial in trials
    ]
    for plan in {plan.trial.scene: plan for plan in plans}.values():
        plan.script(load_scene(plan.trial.scene))  # Invalid options are rejected now, not after minutes of mapping.
    part = Part.parse(options.part)
    shares = [(plan.trial, f"{Path(world).name}-{plan.maintenance}-{part.label}") for plan in plans]
    with (
        sole_evaluation(shares, options.folder),
        workers(options.processes, options.cluster, options.folder) as parallel,
        tqdm(total=options.queries * len(part.of(plans)), desc=f"world {world}", unit="query") as bar,
    ):
        progress = progress_on_bar(bar, len({plan.trial for plan in part.of(plans)}))
        results = run_world_evaluation(
            plans, options.folder, command=command(), parallel=parallel, progress=progress, part=part
        )
    if len(results) < len(plans):
        return PartSummary(str(part), bar.n, len(plans), len(results), options.folder, time.monotonic() - started)
    return _world_summary(options, results, time.monotonic() - started)


def _world_summary(options: LifelongVerb, results: Sequence[WorldResult], wall_s: float) -> WorldSummary:
    names = dict.fromkeys(result.maintenance for result in results)
    found = {name: world_metrics([each for each in results if each.maintenance == name]) for name in names}
    first = results[0]
    metrics = found[first.maintenance]
    return WorldSummary(
        **{field.name: getattr(metrics, field.name) for field in fields(metrics)},
        world=first.world,
        days=first.days,
        scenes=tuple(dict.fromkeys(result.scene for result in results)),
        preset=first.preset,
        without=first.without,
        seeds=options.seed,
        maintenance=first.maintenance,
        by_maintenance=found,
        folder=options.folder,
        wall_s=wall_s,
    )


def _without_world(options: LifelongVerb, maintenance: str | None) -> Summary:
    started = time.monotonic()
    schedule = LifelongSchedule(options.queries, options.every, options.episodes)
    part = Part.parse(options.part)
    plans = [replace(plan, maintenance=maintenance) for plan in trial_plans(options, DEFAULT_SYSTEM, options.episodes)]
    with (
        sole_evaluation(((plan, part.label) for plan in plans), options.folder),
        workers(options.processes, options.cluster, options.folder) as parallel,
        tqdm(total=schedule.work * len(part.of(plans)), desc="lifelong", unit="query") as bar,
    ):
        progress = progress_on_bar(bar, len(part.of(plans)))
        results = run_lifelong(
            plans, options.folder, schedule, command=command(), parallel=parallel, progress=progress, part=part
        )
    if len(results) < len(plans):
        return PartSummary(str(part), bar.n, len(plans), len(results), options.folder, time.monotonic() - started)
    return _summary(options, results, maintenance, time.monotonic() - started)


def _summary(
    options: LifelongVerb, results: Sequence[LifelongResult], maintenance: str | None, wall_s: float
) -> LifelongSummary:
    scenes = dict.fromkeys(result.scene for result in results)
    return LifelongSummary(
        scenes=options.scene,
        preset=options.preset,
        without=options.without,
        maintenance=maintenance,
        seeds=options.seed,
        every=options.every,
        episodes=options.episodes,
        all=lifelong_metrics(results),
        by_scene={scene: lifelong_metrics([each for each in results if each.scene == scene]) for scene in scenes},
        folder=options.folder,
        wall_s=wall_s,
    )
