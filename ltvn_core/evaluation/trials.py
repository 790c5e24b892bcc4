"""Runs trials (many episodes with one map) in batches, in parallel on any number of processes or machines.

A finished batch is a file, and so is each finished episode before that, so an interrupted evaluation continues where it
stopped, on all machines that share the folder.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from ltvn_core.composition import open_predictor
from ltvn_core.evaluation.conditions import light_under, told_conditions
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.ground_truth import floorplan, map_truth_metrics
from ltvn_core.evaluation.gzipped_results import is_stored
from ltvn_core.evaluation.map_drawings import save_drawing
from ltvn_core.evaluation.parts import WHOLE, Part
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import read_share, told_repeatedly
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.query_log import append_to_log, read_query_log
from ltvn_core.evaluation.query_result import QueryBatch
from ltvn_core.evaluation.results import TrialResult, load_results, save_results
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan, claim_files, open_planned_system, planned_weights
from ltvn_core.evaluation.workers import Workers
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.registry import system_entry

EPISODES_PER_BATCH = 25
"""Episodes in a batch: few enough for the cores to finish together, and the map is not loaded too often."""


def _tell_nobody(number: float) -> None:
    """Show nothing."""


@dataclass(frozen=True, slots=True)
class EvaluationProgress:
    """Callbacks for the progress of an evaluation."""

    maps_ready: Callable[[int], object]
    """Called with the number of maps that are ready."""
    work_done: Callable[[int], object]
    """Called with the number of further episodes or queries that are done."""
    preparing: Callable[[float], object] = _tell_nobody
    """Called from a thread, with the share of all drives, weights and maps that is prepared."""
    unfinished: Callable[[int], object] = _tell_nobody
    """Called from a thread, with the number of episodes that are done in batches that are not."""


def open_runner(plan: TrialPlan, files: TrialFiles, queries: int = 0, *, maintain: bool = False) -> EpisodeRunner:
    """Load the map after a number of queries, with its scene and network."""
    scene = load_scene(plan.scene)
    weights = planned_weights(plan, files)
    predictor = open_predictor(plan.predictor, plan.scene, weights)
    system = open_planned_system(plan, predictor, scene, maintain=maintain)
    return EpisodeRunner(
        scene,
        files.map(queries),
        predictor,
        system,
        plan.protocol,
        perturbations=plan.perturbations,
        light=light_under(plan.conditions),
    )


def run_episode_batch(
    plan: TrialPlan, files: TrialFiles, queries: int, first: int, episodes: Sequence[EpisodePlan]
) -> int:
    """Run episodes, numbered from `first`, with the map after a number of queries; return their number.

    Each is saved when it is over, and the next call runs only what is missing.
    """
    path = files.episodes(queries, first, first + len(episodes))
    if not path.exists():
        log = files.unfinished_batch(path)
        done = {result.query: result for result in read_query_log(log)}
        for number, episode in enumerate(episodes, first):
            if number not in done:
                started = time.monotonic()
                result = cached_runner(plan, files, queries).run(number, episode, episode_rng(plan.seed, number))
                done[number] = replace(result, seconds=time.monotonic() - started)
                append_to_log(log, done[number])
        in_order = [done[number] for number in range(first, first + len(episodes))]
        wall_s = sum(result.seconds or 0.0 for result in in_order)
        save_results(path, QueryBatch(tuple(replace(result, seconds=None) for result in in_order), wall_s))
        log.unlink(missing_ok=True)
    return len(episodes)


def episode_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the random generator of one episode."""
    return np.random.default_rng([seed, 3, episode])


@lru_cache(maxsize=1)
def cached_runner(plan: TrialPlan, files: TrialFiles, queries: int) -> EpisodeRunner:
    """Return the runner of a frozen map, cached between batches; its map must not be changed."""
    return open_runner(plan, files, queries)


def run_trials(
    plans: Sequence[TrialPlan],
    folder: Path,
    *,
    episodes: int,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[TrialResult]:
    """Run the static test of several plans, one scene and seed each; existing results are only read.

    A `part` runs its share of the episodes, and returns the results of the plans whose episodes are all done by then,
    whoever ran them. Raises OptionError if the folder has results of other settings.
    """
    mine = _share(plans, episodes, part)
    jobs = prepare_all(list(dict.fromkeys(plan for plan, _ in mine)), folder, parallel, progress)
    batches = {plan: [batch for each, batch in mine if each == plan] for plan, _ in jobs}
    with told_repeatedly(lambda: progress.unfinished(sum(_unfinished_episodes(files) for _, files in jobs))):
        for done in parallel(
            job for plan, files in jobs for job in episode_batch_jobs(plan, files, 0, episodes, batches[plan])
        ):
            progress.work_done(done)
    # Read from the files, because batches finish in any order, and other parts may have run some.
    whole = [(plan, files) for plan, files in _all_files(plans, folder) if _is_complete(files, episodes)]
    list(parallel(delayed(_finish)(plan, files, episodes, command) for plan, files in whole))
    return [load_results(files.trial(episodes), TrialResult) for _, files in whole]


def episodes_to_run(plans: Sequence[TrialPlan], episodes: int, part: Part) -> int:
    """Return how many episodes a part of the static tests of some plans has."""
    return sum(until - first for _, (first, until) in _share(plans, episodes, part))


def _share(plans: Sequence[TrialPlan], episodes: int, part: Part) -> list[tuple[TrialPlan, tuple[int, int]]]:
    """Return the batches of a part."""
    return part.of([(plan, batch) for plan in plans for batch in _batch_ranges(episodes)])


def _all_files(plans: Sequence[TrialPlan], folder: Path) -> list[tuple[TrialPlan, TrialFiles]]:
    return [(plan, TrialFiles.of(plan, folder)) for plan in plans]


def _is_complete(files: TrialFiles, episodes: int) -> bool:
    """Tell whether all episodes of a static test are done, by this command or by others."""
    batches = (files.episodes(0, first, until) for first, until in _batch_ranges(episodes))
    return is_stored(files.trial(episodes)) or (files.map().exists() and all(batch.exists() for batch in batches))


def prepare_all(
    plans: Sequence[TrialPlan], folder: Path, parallel: Workers, progress: EvaluationProgress
) -> list[tuple[TrialPlan, TrialFiles]]:
    """Create drives, weights and maps in parallel; raises as `run_trials`."""
    jobs = _all_files(plans, folder)
    for plan, files in jobs:
        claim_files(plan, files)
    without_data: set[str] = {plan.system for plan, files in jobs if plan.finetuned and not files.weights.exists()}
    for system in without_data:
        system_entry(system).training.rehearsal().prepare()  # Once for all processes.
    with told_repeatedly(lambda: progress.preparing(sum(_share_prepared(files) for _, files in jobs) / len(jobs))):
        for ready, _ in enumerate(parallel(delayed(prepare)(plan, files) for plan, files in jobs), 1):
            progress.maps_ready(ready)
    return jobs


def _unfinished_episodes(files: TrialFiles) -> int:
    """Return how many episodes are done of batches that are not."""
    return sum(len(read_query_log(part)) for part in files.unfinished_batches())


def _share_prepared(files: TrialFiles) -> float:
    return 1.0 if files.map().exists() else read_share(files.preparation)


def episode_batch_jobs(
    plan: TrialPlan,
    files: TrialFiles,
    queries: int,
    episodes: int,
    batches: Sequence[tuple[int, int]] | None = None,
) -> Iterator[Any]:
    """Yield batches of the static test with the map after so many queries, all by default, for `joblib.Parallel`."""
    drawn = prepare(plan, files).episodes(episodes, plan.seed)
    for first, until in _batch_ranges(episodes) if batches is None else batches:
        yield delayed(run_episode_batch)(plan, files, queries, first, drawn[first:until])


def _batch_ranges(episodes: int) -> list[tuple[int, int]]:
    """Return the first episode of each batch, and the one after its last."""
    return [(first, min(first + EPISODES_PER_BATCH, episodes)) for first in range(0, episodes, EPISODES_PER_BATCH)]


def _finish(plan: TrialPlan, files: TrialFiles, episodes: int, command: str) -> None:
    """Save the result of the static test."""
    if not is_stored(files.trial(episodes)):
        keep_drawing(plan, files, 0)
        save_results(files.trial(episodes), finish_trial(plan, files, 0, episodes, command))


def keep_drawing(plan: TrialPlan, files: TrialFiles, queries: int) -> None:
    """Draw the map after so many queries, unless that is done."""
    if not files.drawing(queries).exists():
        runner = cached_runner(plan, files, queries)
        save_drawing(files.drawing(queries), floorplan(runner.graph, runner.truth))


def finish_trial(plan: TrialPlan, files: TrialFiles, queries: int, episodes: int, command: str) -> TrialResult:
    """Combine the batches, and add the metrics of the map."""
    paths = [files.episodes(queries, first, until) for first, until in _batch_ranges(episodes)]
    batches: list[QueryBatch] = [load_results(path, QueryBatch) for path in paths]
    runner = cached_runner(plan, files, queries)
    drive_truth = prepare(plan, files)
    return TrialResult(
        scene=runner.scene.name,
        method=plan.system,
        preset=plan.preset,
        without=plan.parts_off,
        finetuned=plan.finetuned,
        seed=plan.seed,
        queries=queries,
        images=len(drive_truth.frames),
        fingerprint=runner.fingerprint,
        map=map_truth_metrics(runner.graph, runner.truth, drive_truth.goals),
        floorplan=None,
        episodes=tuple(episode for batch in batches for episode in batch.queries),
        wall_s=sum(batch.wall_s for batch in batches),
        version=version("ltvn"),
        command=command,
        without_depth=drive_truth.without_depth,
        perturbations=plan.perturbations,
        conditions=told_conditions(plan.protocol, plan.conditions),
    )
