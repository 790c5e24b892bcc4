"""Runs schedules: lists of segments, which are queries that change the map or episodes that do not.

A static test is one segment of episodes, a lifelong test alternates both kinds, and a test in a changing world is one
segment of queries. Each finished batch is a file, so an interrupted test continues where it stopped, on all machines
that share the folder. Episodes are logged one by one; a batch of queries starts with the map that the previous batch
saved. Random generators, frame numbers and the world depend only on the number of the query, so interruptions do not
change results.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from joblib import delayed

from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress, told_repeatedly
from ltvn_core.evaluation.protocol import EpisodePlan, light_under
from ltvn_core.evaluation.query_result import QueryBatch, QueryResult, append_to_log, read_query_log
from ltvn_core.evaluation.results import load_results, save_results
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan, open_planned_system, planned_weights
from ltvn_core.evaluation.workers import Workers
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.simulation.scene_registry import load_scene

BATCH_SIZE = 25
"""Number of queries or episodes in a batch. Small, so that an interruption loses few and all cores finish at nearly the
same time; large enough that maps are rarely loaded."""


def batch_ranges(first: int, until: int) -> list[tuple[int, int]]:
    """Return the number of the first query or episode of each batch, and the number after its last."""
    return [(begin, min(begin + BATCH_SIZE, until)) for begin in range(first, until, BATCH_SIZE)]


class LearningDrive(Protocol):
    """A map after some queries, which further queries change."""

    def run(self, query: int) -> QueryResult:
        """Drive the next query."""
        ...

    def save_map(self, queries: int) -> None:
        """Save the map after a number of queries."""
        ...

    def check(self, results: Sequence[QueryResult]) -> tuple[QueryResult, ...]:
        """Add checks that take longer to the results of a batch."""
        ...


class QueryFiles(Protocol):
    """Paths of the maps and results of queries."""

    def map(self, queries: int) -> Path:
        """Return the path of the map after a number of queries."""
        ...

    def query_batch(self, first: int, until: int) -> Path:
        """Return the path of the results of the queries from `first` up to `until`."""
        ...


@dataclass(frozen=True, slots=True)
class Queries:
    """Queries that change the map, from `first` up to `until`, one by one."""

    first: int
    until: int


@dataclass(frozen=True, slots=True)
class Episodes:
    """Random episodes with the map after `first` queries, which they do not change."""

    first: int
    count: int
    batches: tuple[tuple[int, int], ...] | None = None
    """Selected batches; None is all."""


@dataclass(frozen=True, slots=True)
class ScheduledTest:
    """A plan, its files, and the segments of its schedule."""

    plan: TrialPlan
    files: TrialFiles
    segments: tuple[Queries | Episodes, ...]
    open_drive: Callable[[int], LearningDrive] | None = None
    """Opens the map after a number of queries for further ones; needed only by segments of queries."""
    query_files: QueryFiles | None = None
    """Files of the maps and results of queries; None if these are the files of the plan."""

    @property
    def learned(self) -> QueryFiles:
        """Files of the maps and results of queries."""
        return self.query_files or self.files

    def jobs(self, kind: type[Queries | Episodes], first: int) -> Iterator[Any]:
        """Yield the jobs, for `joblib.Parallel`, of all segments of one kind that begin with the map after `first`
        queries."""
        for segment in self.segments:
            if segment.first != first or not isinstance(segment, kind):
                continue
            if isinstance(segment, Queries):
                assert self.open_drive is not None
                yield delayed(run_query_batches)(self.open_drive, self.learned, segment.first, segment.until)
            else:
                drawn = prepare(self.plan, self.files).episodes(segment.count, self.plan.seed)
                for begin, end in batch_ranges(0, segment.count) if segment.batches is None else segment.batches:
                    yield delayed(run_episode_batch)(self.plan, self.files, first, begin, drawn[begin:end])

    def unfinished(self) -> int:
        """Return the number of finished queries and episodes in unfinished jobs."""
        done = 0
        if any(isinstance(segment, Episodes) for segment in self.segments):
            done += sum(len(read_query_log(part)) for part in self.files.unfinished_batches())
        for segment in self.segments:
            if isinstance(segment, Queries):
                stored = sum(
                    end - begin
                    for begin, end in batch_ranges(segment.first, segment.until)
                    if self.learned.query_batch(begin, end).exists()
                )
                done += stored if stored < segment.until - segment.first else 0
        return done


def run_segments(tests: Sequence[ScheduledTest], parallel: Workers, progress: EvaluationProgress) -> None:
    """Run the unfinished parts of tests, in groups of segments that start after the same number of queries.

    In each group, queries come first, because they take long and cannot run in parallel.
    """
    with told_repeatedly(lambda: progress.unfinished(sum(test.unfinished() for test in tests))):
        for first in sorted({segment.first for test in tests for segment in test.segments}):
            for done in parallel(
                job for kind in (Queries, Episodes) for test in tests for job in test.jobs(kind, first)
            ):
                progress.work_done(done)


def run_query_batches(open_drive: Callable[[int], LearningDrive], files: QueryFiles, first: int, until: int) -> int:
    """Drive the queries from `first` up to `until` in batches; return their number."""
    for begin, end in batch_ranges(first, until):
        run_query_batch(open_drive, files, begin, end)
    return until - first


def run_query_batch(open_drive: Callable[[int], LearningDrive], files: QueryFiles, first: int, until: int) -> None:
    """Drive a batch of queries, starting with the map after `first` queries.

    Writes the map and the results; does nothing if both files exist.
    """
    if files.query_batch(first, until).exists() and files.map(until).exists():
        return
    started = time.monotonic()
    drive = open_drive(first)
    results = [drive.run(query) for query in range(first, until)]
    if not files.map(until).exists():
        drive.save_map(until)
    if not files.query_batch(first, until).exists():
        batch = QueryBatch(drive.check(results), time.monotonic() - started)
        save_results(files.query_batch(first, until), batch)


def load_batches(files: QueryFiles, first: int, until: int) -> list[QueryBatch]:
    """Read the results of the queries from `first` up to `until`. Raises OptionError if some are missing."""
    return [load_results(files.query_batch(*each), QueryBatch) for each in batch_ranges(first, until)]


def run_episode_batch(
    plan: TrialPlan, files: TrialFiles, queries: int, first: int, episodes: Sequence[EpisodePlan]
) -> int:
    """Run episodes, numbered from `first`, with the map after a number of queries; return their number.

    Each is saved when it is over, and the next call runs only the missing ones.
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


def open_runner(plan: TrialPlan, files: TrialFiles, queries: int = 0, *, maintain: bool = False) -> EpisodeRunner:
    """Load the map after a number of queries, with its scene and network."""
    scene = load_scene(plan.scene)
    weights = planned_weights(plan, files)
    predictor = open_predictor(plan.predictor, plan.scene, weights)
    system = open_planned_system(plan, predictor, scene, maintain=maintain)
    return EpisodeRunner(
        scene,
        TopologicalMap.load(files.map(queries), predictor, system=system),
        plan.protocol,
        perturbations=plan.perturbations,
        light=light_under(plan.conditions),
    )


@lru_cache(maxsize=1)
def cached_runner(plan: TrialPlan, files: TrialFiles, queries: int) -> EpisodeRunner:
    """Return the runner of a frozen map, cached between batches; its map must not be changed."""
    return open_runner(plan, files, queries)
