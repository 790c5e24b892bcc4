"""`ltvn lifelong`: the paper's lifelong test, and the same in a world that changes."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.evaluate import ProtocolOptions, command
from ltvn_core.verbs.part_summary import PartSummary
from ltvn_core.verbs.verb import Summary
from ltvn_core.verbs.world_summary import WorldSummary

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ltvn_core.evaluation.lifelong_metrics import LifelongMetrics
    from ltvn_core.evaluation.results import LifelongResult


@dataclass(frozen=True)
class LifelongSummary:
    """What the lifelong tests of all scenes and seeds came to."""

    scenes: tuple[str, ...]
    preset: str
    without: tuple[str, ...]
    maintenance: str | None
    """None is what the system does."""
    seeds: tuple[int, ...]
    every: int
    """Queries between two static tests."""
    episodes: int
    """Of each static test."""
    all: "LifelongMetrics"
    by_scene: "dict[str, LifelongMetrics]"
    folder: Path
    """Holds drives, weights, maps and results; called again, the verb goes on from there."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class LifelongVerb(ProtocolOptions):
    """Test lifelong maintenance as the paper does: many queries with it, and static episodes without it in between."""

    queries: int = 700
    """Queries with maintenance for each scene and seed."""
    every: int = 100
    """Queries between two static tests; there is one before the first query too."""
    episodes: int = 500
    """Random episodes of each static test, always the same."""

    maintenance: tuple[MaintenanceName, ...] = ()
    """What driving teaches the map; by default what its system does. static: nothing; paper, robust: beliefs and
    pruning as in that preset; brm: BRM's posterior, which prunes nothing; brm-rooms: the same of ways between rooms;
    persistent: also what is open at which time; truth: what the world knows, with --world. Several
    are compared on the same queries of a --world."""
    world: str | None = None
    """Drive the queries in a world that changes instead, with no static tests: static, doors, daily, telegraph, moving,
    light, people, crowd, all, several of them (doors+moving), or a JSON file with a script. Goals are those that can be
    reached when a query begins."""
    days: float = 7.0
    """Simulated days over which the queries in a changing world are spread."""

    def run(self) -> Summary:
        """Run what is not done yet.

        Raises OptionError, SceneError, WeightsError, MapError, RecordingError, and WorldError.
        """
        if len({*self.maintenance}) < len(self.maintenance):
            raise OptionError("--maintenance has a name twice.")
        if self.world is not None and self.conditions:
            raise OptionError("A --world has light and doors of its own; leave --conditions out, or name no world.")
        if self.world is not None:
            return self._in_world(self.world)
        if len(self.maintenance) > 1 or {"truth", "brm-rooms"} & {*self.maintenance}:
            raise OptionError(
                "Without --world, --maintenance takes one name, and not truth or brm-rooms, which ask the world. Name "
                "a world that changes, or run the command once for each."
            )
        return self._without_world(self.maintenance[0] if self.maintenance else None)

    def _in_world(self, world: str) -> Summary:
        from tqdm import tqdm

        from ltvn_core.evaluation.parts import Part
        from ltvn_core.evaluation.workers import workers
        from ltvn_core.evaluation.worlds.world_evaluation import run_world_evaluation
        from ltvn_core.evaluation.worlds.world_plans import WorldPlan
        from ltvn_core.simulation.scene_registry import load_scene
        from ltvn_core.verbs.evaluation_bar import progress_on_bar

        started = time.monotonic()
        trials = self.plans(DEFAULT_SYSTEM, self.episodes)
        plans = [
            WorldPlan(trial=trial, world=world, maintenance=name, queries=self.queries, days=self.days)
            for name in self.maintenance or (self.preset,)
            for trial in trials
        ]
        for plan in {plan.trial.scene: plan for plan in plans}.values():
            plan.script(load_scene(plan.trial.scene))  # What it refuses is said now, not after minutes of mapping.
        part = Part.parse(self.part)
        with (
            workers(self.workers, self.cluster, self.folder) as parallel,
            tqdm(total=self.queries * len(part.of(plans)), desc=f"world {world}", unit="query") as bar,
        ):
            progress = progress_on_bar(bar, len({plan.trial for plan in part.of(plans)}))
            results = run_world_evaluation(
                plans, self.folder, command=command(), parallel=parallel, progress=progress, part=part
            )
        if len(results) < len(plans):
            return PartSummary(str(part), bar.n, len(plans), len(results), self.folder, time.monotonic() - started)
        return WorldSummary.of(results, seeds=self.seed, folder=self.folder, wall_s=time.monotonic() - started)

    def _without_world(self, maintenance: str | None) -> Summary:
        from tqdm import tqdm

        from ltvn_core.evaluation.lifelong_evaluation import Schedule, run_lifelong
        from ltvn_core.evaluation.parts import Part
        from ltvn_core.evaluation.workers import workers
        from ltvn_core.verbs.evaluation_bar import progress_on_bar

        started, schedule = time.monotonic(), Schedule(self.queries, self.every, self.episodes)
        part = Part.parse(self.part)
        plans = [replace(plan, maintenance=maintenance) for plan in self.plans(DEFAULT_SYSTEM, self.episodes)]
        with (
            workers(self.workers, self.cluster, self.folder) as parallel,
            tqdm(total=schedule.work * len(part.of(plans)), desc="lifelong", unit="query") as bar,
        ):
            progress = progress_on_bar(bar, len(part.of(plans)))
            results = run_lifelong(
                plans, self.folder, schedule, command=command(), parallel=parallel, progress=progress, part=part
            )
        if len(results) < len(plans):
            return PartSummary(str(part), bar.n, len(plans), len(results), self.folder, time.monotonic() - started)
        return self._summary(results, maintenance, time.monotonic() - started)

    def _summary(self, results: "Sequence[LifelongResult]", maintenance: str | None, wall_s: float) -> LifelongSummary:
        from ltvn_core.evaluation.lifelong_metrics import lifelong_metrics

        scenes = dict.fromkeys(result.scene for result in results)
        return LifelongSummary(
            scenes=self.scene,
            preset=self.preset,
            without=self.without,
            maintenance=maintenance,
            seeds=self.seed,
            every=self.every,
            episodes=self.episodes,
            all=lifelong_metrics(results),
            by_scene={scene: lifelong_metrics([each for each in results if each.scene == scene]) for scene in scenes},
            folder=self.folder,
            wall_s=wall_s,
        )
