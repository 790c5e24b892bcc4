"""The lifelong evaluation: queries with maintenance, and at intervals the static test with the map of that time.

The queries of one map run one after the other; those of different maps, and the static tests of existing maps, run in
parallel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

from joblib import delayed

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.ground_truth import calibration_bins
from ltvn_core.evaluation.gzipped_results import is_stored
from ltvn_core.evaluation.lifelong_drive import LifelongDrive
from ltvn_core.evaluation.parts import WHOLE, Part
from ltvn_core.evaluation.preparation_progress import EvaluationProgress
from ltvn_core.evaluation.results import LifelongPoint, LifelongResult, load_results, save_results
from ltvn_core.evaluation.segments import (
    Episodes,
    Queries,
    ScheduledTest,
    cached_runner,
    load_batches,
    run_segments,
)
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.evaluation.trials import finish_trial, keep_drawing, prepare_all
from ltvn_core.evaluation.workers import Workers


@dataclass(frozen=True, slots=True)
class LifelongSchedule:
    """Number of queries, and when the map is tested."""

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
        """Numbers of queries after which the map is tested, from 0 to all."""
        return (*range(0, self.queries, self.every), self.queries)

    @property
    def segments(self) -> tuple[Queries | Episodes, ...]:
        """The static tests, and the queries between them."""
        tests = (Episodes(at, self.episodes) for at in self.points)
        return (*tests, *(Queries(first, until) for first, until in pairwise(self.points)))

    @property
    def work(self) -> int:
        """Total number of queries and episodes."""
        return self.queries + self.episodes * len(self.points)


def run_lifelong(
    plans: Sequence[TrialPlan],
    folder: Path,
    schedule: LifelongSchedule,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[LifelongResult]:
    """Run the lifelong evaluation of several plans, one scene and seed each; existing results are only read.

    A `part` runs its share of the plans, and returns the results of all that are done by then, whoever ran them. Raises
    OptionError if the folder has results of other settings.
    """
    jobs = prepare_all(part.of(plans), folder, parallel, progress)
    run_segments([_scheduled(plan, files, schedule) for plan, files in jobs], parallel, progress)
    list(parallel(delayed(_finish)(plan, files, schedule, command) for plan, files in jobs))
    results = (_result_file(TrialFiles.of(plan, folder), schedule) for plan in plans)
    return [load_results(result, LifelongResult) for result in results if is_stored(result)]


def _scheduled(plan: TrialPlan, files: TrialFiles, schedule: LifelongSchedule) -> ScheduledTest:
    return ScheduledTest(plan, files, schedule.segments, partial(LifelongDrive, plan, files))


def _finish(plan: TrialPlan, files: TrialFiles, schedule: LifelongSchedule, command: str) -> None:
    """Combine the batches and save the result."""
    if is_stored(_result_file(files, schedule)):
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
            query
            for first, until in pairwise(schedule.points)
            for batch in load_batches(files, first, until)
            for query in batch.queries
        ),
        version=version("ltvn"),
        command=command,
        maintenance=plan.maintenance,
    )
    save_results(_result_file(files, schedule), result)


def _point(plan: TrialPlan, files: TrialFiles, at: int, episodes: int, command: str) -> LifelongPoint:
    runner = cached_runner(plan, files, at)
    cells = calibration_bins(runner.map.graph, runner.truth)
    return LifelongPoint(at, finish_trial(plan, files, at, episodes, command), cells)


def _result_file(files: TrialFiles, schedule: LifelongSchedule) -> Path:
    return files.lifelong(schedule.queries, schedule.every, schedule.episodes)
