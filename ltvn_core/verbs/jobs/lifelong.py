"""`ltvn lifelong`: the paper's lifelong test, and the same test in a changing world."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.metrics import LifelongMetrics, lifelong_metrics
from ltvn_core.evaluation.plans import Schedule
from ltvn_core.evaluation.results import Run
from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.evaluation.worlds.world_schedule import check_world
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.jobs.evaluate import run_on_bar, run_plans_of
from ltvn_core.verbs.jobs.evaluation_progress import PartSummary
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
    if options.queries < 1:
        raise OptionError(f"--queries must be 1 or more, got {options.queries}.")
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
    schedule = Schedule(queries=options.queries, every=options.every, world=world, days=options.days)
    plans = [
        replace(plan, maintenance=name, schedule=schedule)
        for name in options.maintenance or (options.preset,)
        for plan in run_plans_of(options, DEFAULT_SYSTEM, options.episodes)
    ]
    for plan in {plan.scene: plan for plan in plans}.values():
        check_world(plan)  # Invalid options are rejected now, not after minutes of mapping.
    found = run_on_bar(options, plans, title=f"world {world}", unit="query")
    return found if isinstance(found, PartSummary) else _world_summary(options, *found)


def _world_summary(options: LifelongVerb, results: Sequence[Run], wall_s: float) -> WorldSummary:
    by_name: dict[str, list[Run]] = {}
    for result in results:
        by_name.setdefault(result.columns.maintenance or "", []).append(result)
    found = {name: world_metrics(several) for name, several in by_name.items()}
    first, metrics = next(iter(found.items()))
    return WorldSummary(
        **{field.name: getattr(metrics, field.name) for field in fields(metrics)},
        world=options.world or "",
        days=options.days,
        scenes=tuple(dict.fromkeys(result.columns.scene for result in results)),
        preset=options.preset,
        without=results[0].columns.without,
        seeds=options.seed,
        maintenance=first,
        by_maintenance=found,
        folder=options.folder,
        wall_s=wall_s,
    )


def _without_world(options: LifelongVerb, maintenance: str | None) -> Summary:
    schedule = Schedule(queries=options.queries, every=options.every)
    plans = [
        replace(plan, maintenance=maintenance, schedule=schedule)
        for plan in run_plans_of(options, DEFAULT_SYSTEM, options.episodes)
    ]
    found = run_on_bar(options, plans, title="lifelong", unit="query")
    return found if isinstance(found, PartSummary) else _summary(options, *found, maintenance)


def _summary(options: LifelongVerb, results: Sequence[Run], wall_s: float, maintenance: str | None) -> LifelongSummary:
    scenes = dict.fromkeys(result.columns.scene for result in results)
    return LifelongSummary(
        scenes=options.scene,
        preset=options.preset,
        without=options.without,
        maintenance=maintenance,
        seeds=options.seed,
        every=options.every,
        episodes=options.episodes,
        all=lifelong_metrics(results),
        by_scene={
            scene: lifelong_metrics([each for each in results if each.columns.scene == scene]) for scene in scenes
        },
        folder=options.folder,
        wall_s=wall_s,
    )
