"""The lifelong test: queries with maintenance, and in between the static test with the map as it is then.

Owns the order of the work. The queries of one map follow each other; those of different maps, and the static tests of
maps that are there already, run side by side.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

from joblib import delayed

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.ground_truth import calibration_bins
from ltvn_core.evaluation.lifelong_batches import load_queries, run_queries
from ltvn_core.evaluation.results import LifelongPoint, LifelongResult, load_results, save_results
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.evaluation.trials import (
    EvaluationProgress,
    cached_runner,
    episode_batch_jobs,
    finish_trial,
    keep_drawing,
    prepare_all,
)
from ltvn_core.evaluation.workers import Workers


@dataclass(frozen=True, slots=True)
class Schedule:
    """How long a life is, and when it is tested."""

    queries: int = 700
    """With maintenance (paper)."""
    every: int = 100
    """Queries between two static tests (paper)."""
    episodes: int = 500
    """Of each static test (paper)."""

    def __post_init__(self) -> None:
        if min(self.queries, self.every, self.episodes) < 1:
            raise OptionError(
                "A lifelong test needs one query, one between two tests and one episode at least, got "
                f"{self.queries} queries, every {self.every}, {self.episodes} episodes."
            )

    @property
    def points(self) -> tuple[int, ...]:
        """After how many queries the map is tested: before the first, in between, and after the last."""
        return (*range(0, self.queries, self.every), self.queries)

    @property
    def work(self) -> int:
        """Queries and episodes in all."""
        return self.queries + self.episodes * len(self.points)


def run_lifelong(
    plans: Sequence[TrialPlan],
    folder: Path,
    schedule: Schedule,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
) -> list[LifelongResult]:
    """Run the lifelong test of several plans, with one scene and seed each; what is done already is only read.

    Raises OptionError where the folder holds results of other settings, and the errors of the parts.
    """
    jobs = prepare_all(plans, folder, parallel, progress)
    for at in schedule.points:
        for done in parallel(_jobs_at(jobs, schedule, at)):
            progress.work_done(done)
    list(parallel(delayed(_finish)(plan, files, schedule, command) for plan, files in jobs))
    return [load_results(_result_file(files, schedule), LifelongResult) for _, files in jobs]


def _jobs_at(jobs: Sequence[tuple[TrialPlan, TrialFiles]], schedule: Schedule, at: int) -> Iterator[Any]:
    """Yield what can be done with the maps after `at` queries: the queries that follow, and then the static test.

    The queries come first, because each takes long and cannot be shared out.
    """
    for first, until in pairwise(schedule.points):
        if first == at:
            yield from (delayed(run_queries)(plan, files, first, until) for plan, files in jobs)
    for plan, files in jobs:
        yield from episode_batch_jobs(plan, files, at, schedule.episodes)


def _finish(plan: TrialPlan, files: TrialFiles, schedule: Schedule, command: str) -> None:
    """Put the pieces together; the result is kept as a file."""
    if _result_file(files, schedule).exists():
        return
    points = tuple(_point(plan, files, at, schedule.episodes, command) for at in schedule.points)
    for at in (schedule.points[0], schedule.points[-1]):  # Figures show the map before and after.
        keep_drawing(plan, files, at)
    result = LifelongResult(
        scene=points[0].trial.scene,
        preset=plan.preset,
        without=plan.parts_off,
        seed=plan.seed,
        points=points,
        queries=tuple(
            query for first, until in pairwise(schedule.points) for query in load_queries(files, first, until)
        ),
        version=version("ltvn"),
        command=command,
    )
    save_results(_result_file(files, schedule), result)


def _point(plan: TrialPlan, files: TrialFiles, at: int, episodes: int, command: str) -> LifelongPoint:
    runner = cached_runner(plan, files, at)
    cells = calibration_bins(runner.graph, runner.truth)
    return LifelongPoint(at, finish_trial(plan, files, at, episodes, command), cells)


def _result_file(files: TrialFiles, schedule: Schedule) -> Path:
    return files.lifelong(schedule.queries, schedule.every, schedule.episodes)
