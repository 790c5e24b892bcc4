"""`ltvn lifelong`: the paper's lifelong test, and the same test in a changing world."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.evaluate import PartSummary, ProtocolOptions, run_on_bar, run_plans_of
from ltvn_core.verbs.verb import FLAT, Summary

if TYPE_CHECKING:
    from ltvn_core.evaluation.metrics import LifelongMetrics
    from ltvn_core.evaluation.results import Run
    from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics


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
    all: "LifelongMetrics"
    by_scene: "dict[str, LifelongMetrics]"
    folder: Path
    """Folder of drives, weights, maps and results; a second call of the verb continues from them."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class WorldSummary:
    """Results of the queries in a changing world; the numbers are those of the first maintenance."""

    metrics: "WorldMetrics" = field(metadata=FLAT)
    world: str
    days: float
    scenes: tuple[str, ...]
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    maintenance: str
    """The first maintenance of the command line."""
    by_maintenance: "dict[str, WorldMetrics]"
    """All numbers of each maintenance."""
    folder: Path
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class LifelongVerb(ProtocolOptions):
    """Test lifelong maintenance as in the paper: many queries with maintenance, and static episodes without it in
    between."""

    queries: int = 700
    """Number of queries with maintenance for each scene and seed."""
    every: int = 100
    """Number of queries between two static tests; there is also a test before the first query."""
    episodes: int = 500
    """Number of random episodes in each static test, the same ones every time."""

    maintenance: tuple[MaintenanceName, ...] = ()
    """How driving updates the map; by default as in the map's system. static: not at all; paper, robust: beliefs and
    pruning of that preset; brm: the posterior of BRM, which prunes nothing; brm-rooms: the same for connections between
    rooms; persistent: also learns when edges are open; truth: ground truth of the world, with --world. With --world,
    several are compared on the same queries."""
    world: str | None = None
    """Drive the queries in a changing world, without static tests: static, doors, daily, telegraph, moving, light,
    people, crowd, all, several of them (doors+moving), or a JSON file with a script. Goals are nodes that can be
    reached when the query begins."""
    days: float = 7.0
    """Number of simulated days over which the queries in a changing world are spread."""

    def run(self) -> Summary:
        """Run all tests that have no result yet.

        Raises OptionError, SceneError, WeightsError, MapError, RecordingError, and WorldError.
        """
        if self.queries < 1:
            raise OptionError(f"--queries must be 1 or more, got {self.queries}.")
        if len({*self.maintenance}) < len(self.maintenance):
            raise OptionError("--maintenance has a name twice.")
        if self.world is not None and self.conditions:
            raise OptionError("A --world already changes light and doors; omit --conditions or --world.")
        names = self.maintenance
        if self.world is None and (len(names) > 1 or {"truth", "brm-rooms"} & {*names}):
            raise OptionError(
                "Without --world, --maintenance takes one name, and not truth or brm-rooms, which need a simulated "
                "world. Name a --world, or run the command once for each."
            )
        return self._test(names or (self.preset if self.world is not None else None,))

    def _test(self, names: "Sequence[MaintenanceName | None]") -> Summary:
        """Run the tests of some maintenances; None is that of the system."""
        from ltvn_core.evaluation.plans import Schedule
        from ltvn_core.evaluation.worlds.world_schedule import check_world

        schedule = Schedule(queries=self.queries, every=self.every, world=self.world, days=self.days)
        found = run_plans_of(self, DEFAULT_SYSTEM, self.episodes)
        plans = [replace(plan, maintenance=name, schedule=schedule) for name in names for plan in found]
        if self.world is not None:
            for plan in {plan.scene: plan for plan in plans}.values():
                check_world(plan)  # Invalid options are rejected now, not after minutes of mapping.
        title = f"world {self.world}" if self.world is not None else "lifelong"
        done = run_on_bar(self, plans, title=title, unit="query")
        if isinstance(done, PartSummary):
            return done
        return _summary(self, *done, names[0]) if self.world is None else _world_summary(self, *done)


def _world_summary(options: LifelongVerb, results: "Sequence[Run]", wall_s: float) -> WorldSummary:
    from ltvn_core.evaluation.worlds.world_metrics import world_metrics

    by_name: dict[str, list[Run]] = {}
    for result in results:
        by_name.setdefault(result.columns.maintenance or "", []).append(result)
    found = {name: world_metrics(several) for name, several in by_name.items()}
    first, metrics = next(iter(found.items()))
    return WorldSummary(
        metrics=metrics,
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


def _summary(
    options: LifelongVerb, results: "Sequence[Run]", wall_s: float, maintenance: str | None
) -> LifelongSummary:
    from ltvn_core.evaluation.metrics import lifelong_metrics

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
