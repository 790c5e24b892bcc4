"""Runs plans: prepares their maps, drives the queries and episodes of their schedules, and reads the results.

A job is a batch of episodes with one map, a stretch of queries that change a map, or the line about a map. Results are
lines in files (see `results`), so an interrupted evaluation continues with the queries that have no line, on all
machines that share the folder. Random generators, frame numbers and the world depend only on the number of the query,
so interruptions do not change results.

Failed episodes can be repeated exactly and recorded; such a recording begins with the map, so `ltvn replay` needs no
other file.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from joblib import delayed

from ltvn_core.atomic_files import atomic_output, atomic_replacement, write_text_atomically
from ltvn_core.data.recording.recorded_run import RecordedRobot, RunDescription
from ltvn_core.errors import RecordingError
from ltvn_core.evaluation.episode_runner import EpisodeRunner, cached_runner, episode_rng, open_runner
from ltvn_core.evaluation.ground_truth import calibration_bins, floorplan, map_truth_metrics
from ltvn_core.evaluation.map_drawing import save_drawing
from ltvn_core.evaluation.plans import (
    RunFiles,
    RunPlan,
    claim_files,
)
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress, read_share, told_repeatedly
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.results import (
    ROWS,
    Run,
    TestedMap,
    append_rows,
    columns_line,
    load_results,
    read_queries,
    read_runs,
)
from ltvn_core.evaluation.workers import WHOLE, Part, Workers
from ltvn_core.evaluation.worlds.world_schedule import WorldSchedule, draw_world_schedule
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.fine_tuning_data import system_training

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


_Share: TypeAlias = dict[RunPlan, list[tuple[int, int]]]
"""Plans, and the batches of episodes of their static tests."""


def share_of(plans: Sequence[RunPlan], part: Part) -> _Share:
    """Return the plans of a part, with their batches of episodes.

    Plans without maintenance are shared out by batches, and others as a whole, because their queries follow each other.
    """
    units = [(plan, batches) for plan in plans for batches in _units(plan)]
    share: _Share = {}
    for plan, batches in part.of(units):
        share.setdefault(plan, []).extend(batches)
    return share


def _units(plan: RunPlan) -> list[list[tuple[int, int]]]:
    batches = batch_ranges(0, plan.protocol.episodes)
    return [batches] if plan.schedule.queries else [[batch] for batch in batches]


def work_in(share: _Share) -> int:
    """Return the number of queries and episodes in a share."""
    tested = {plan: sum(until - first for first, until in batches) for plan, batches in share.items()}
    return sum(plan.schedule.queries + len(plan.schedule.tests) * episodes for plan, episodes in tested.items())


def run_plans(
    plans: Sequence[RunPlan],
    folder: Path,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[Run]:
    """Run all queries and episodes of some plans that have no result yet.

    A `part` runs its share. Returns the finished runs, including the work of other parts. Raises OptionError if the
    folder has results with other settings, and WorldError if a changing world is impossible in its scene.
    """
    share = share_of(plans, part)
    _prepare_all(list(share), folder, parallel, progress)
    jobs = [_Job(plan, RunFiles.of(plan, folder), tuple(batches), command) for plan, batches in share.items()]
    rows = _UnfinishedRows(jobs)
    with told_repeatedly(lambda: progress.unfinished(rows.count())):
        for after in sorted({after for job in jobs for after in job.beginnings}):
            # Stretches come first, because they take long and cannot run in parallel.
            learning = (work for job in jobs for work in job.stretches(after))
            testing = (work for job in jobs for work in (*job.maps(after), *job.episodes(after)))
            for done in parallel(chain(learning, testing)):
                progress.work_done(done)
    return [run for plan in plans if (run := finished_run(plan, folder)) is not None]


def finished_run(plan: RunPlan, folder: Path) -> Run | None:
    """Read the results of a plan; None if some are missing."""
    run = _stored(RunFiles.of(plan, folder))
    schedule = plan.schedule
    tests = {known.after: known for known in run.maps} if run else {}
    if run is None or len(run.queries) < schedule.queries or not tests.keys() >= {0, *schedule.tests}:
        return None
    count = plan.protocol.episodes if schedule.tests else 0
    maps = [replace(tests[at], episodes=tests[at].episodes[:count]) for at in schedule.tests or (0,)]
    if any([each.query for each in known.episodes] != list(range(count)) for known in maps):
        return None
    return replace(run, maps=tuple(maps), queries=run.queries[: schedule.queries])


def _stored(files: RunFiles) -> Run | None:
    return next(iter(read_runs(sorted(files.run.glob(ROWS)))), None)


def _prepare_all(plans: Sequence[RunPlan], folder: Path, parallel: Workers, progress: EvaluationProgress) -> None:
    """Create drives, weights, maps and the queries of changing worlds in parallel."""
    jobs = [(plan, RunFiles.of(plan, folder)) for plan in plans]
    for plan, files in jobs:
        claim_files(plan, files)
    without_data: set[str] = {plan.system for plan, files in jobs if plan.finetuned and not files.weights.exists()}
    for system in without_data:
        system_training(system_entry(system)).rehearsal().prepare()  # Prepared once for all processes.
    with told_repeatedly(lambda: progress.preparing(sum(_share_prepared(files) for _, files in jobs) / len(jobs))):
        for ready, _ in enumerate(parallel(delayed(prepare)(plan, files) for plan, files in jobs), 1):
            progress.maps_ready(ready)
    in_worlds = {files.world_queries: (plan, files) for plan, files in jobs if plan.schedule.world}
    list(parallel(delayed(draw_world_schedule)(*job) for job in in_worlds.values()))


def _share_prepared(files: RunFiles) -> float:
    share = read_share(files.preparation)  # Read first, because the file disappears once the map is there.
    return 1.0 if files.map().exists() else share


@dataclass(frozen=True, slots=True)
class _Job:
    """The share of a plan that this command runs, cut into calls for `joblib.Parallel`."""

    plan: RunPlan
    files: RunFiles
    batches: tuple[tuple[int, int], ...]
    """Batches of episodes of each static test."""
    command: str

    @property
    def beginnings(self) -> tuple[int, ...]:
        """Numbers of queries before each static test and each stretch of queries."""
        return self.plan.schedule.tests or (0,)

    def stretches(self, after: int) -> Iterator[Any]:
        """Yield the stretch of queries that begins with the map after some others."""
        for first, until in self.plan.schedule.stretches:
            if first == after:
                yield delayed(run_stretch)(self.plan, self.files, first, until)

    def maps(self, after: int) -> Iterator[Any]:
        """Yield the description of a map."""
        if after in self.beginnings and not self.files.map_row(after).exists():
            yield delayed(describe_map)(self.plan, self.files, after, self.command)

    def episodes(self, after: int) -> Iterator[Any]:
        """Yield the batches of a static test."""
        if after in self.plan.schedule.tests:
            drawn = prepare(self.plan, self.files).episodes(self.plan.protocol.episodes, self.plan.seed)
            for first, until in self.batches:
                yield delayed(run_episodes)(self.plan, self.files, after, first, drawn[first:until])

    def files_of_rows(self) -> Iterator[tuple[tuple[Path, ...], int]]:
        """Yield the files of lines that each call writes, and its number of queries or episodes."""
        for after in self.plan.schedule.tests:
            yield from (((self.files.episodes(after, first),), until - first) for first, until in self.batches)
        for first, until in self.plan.schedule.stretches:
            yield tuple(self.files.query_batch(*batch) for batch in batch_ranges(first, until)), until - first


class _UnfinishedRows:
    """Counts the lines of calls that are not finished."""

    def __init__(self, jobs: Sequence[_Job]) -> None:
        self._calls = dict(call for job in jobs for call in job.files_of_rows())

    def count(self) -> int:
        """Return the number of lines; the files of a finished call are not read again."""
        found = {paths: sum(_lines(path) for path in paths) for paths in self._calls}
        self._calls = {paths: size for paths, size in self._calls.items() if found[paths] < size}
        return sum(found[paths] for paths in self._calls)


def _lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def describe_map(plan: RunPlan, files: RunFiles, after: int, command: str) -> int:
    """Write the line about a map and its drawing; return 0, because no query is done."""
    truth = prepare(plan, files)
    runner = cached_runner(plan, files, after)
    learns, world = plan.schedule.queries, plan.schedule.world
    graph = runner.map.graph
    if not files.drawing(after).exists() and (after in (0, learns)):  # Figures show no others.
        save_drawing(files.drawing(after), floorplan(graph, runner.truth))
    line = TestedMap(
        columns=plan.columns,
        after=after,
        images=len(truth.frames),
        without_depth=truth.without_depth,
        fingerprint=runner.map.predictor.fingerprint,
        map=map_truth_metrics(graph, runner.truth, truth.goals),
        calibration=calibration_bins(graph, runner.truth)
        if plan.schedule.stretches and not plan.schedule.world
        else (),
        doors=load_results(files.world_queries, WorldSchedule).doors if world else (),
        version=version("ltvn"),
        command=command,
    )
    with atomic_replacement(files.map_row(after)) as new:  # Parts on other machines write the same line.
        new.write_text(f"{columns_line(line.columns, line)}\n", encoding="utf-8")
    return 0


def run_stretch(plan: RunPlan, files: RunFiles, first: int, until: int) -> int:
    """Drive the queries from `first` up to `until` in batches; return their number."""
    for begin, end in batch_ranges(first, until):
        run_query_batch(plan, files, begin, end)
    return until - first


def open_drive(plan: RunPlan, files: RunFiles, first: int) -> LearningDrive:
    """Return the map after `first` queries for further ones, in the world of the plan."""
    if plan.schedule.world:
        from ltvn_core.evaluation.worlds.world_drive import WorldDrive

        return WorldDrive(plan, files, first)
    from ltvn_core.evaluation.lifelong_drive import LifelongDrive

    return LifelongDrive(plan, files, first)


def run_query_batch(plan: RunPlan, files: RunFiles, first: int, until: int) -> None:
    """Drive a batch of queries, starting with the map after `first` queries.

    Writes the map and the results; does nothing if both files exist.
    """
    if files.query_batch(first, until).exists() and files.map(until).exists():
        return
    drive = open_drive(plan, files, first)
    results = [_timed(partial(drive.run, query)) for query in range(first, until)]
    if not files.map(until).exists():
        drive.save_map(until)
    if not files.query_batch(first, until).exists():
        lines = (columns_line(plan.columns, result) for result in drive.check(results))
        write_text_atomically(files.query_batch(first, until), "".join(f"{line}\n" for line in lines))


def run_episodes(plan: RunPlan, files: RunFiles, after: int, first: int, episodes: Sequence[EpisodePlan]) -> int:
    """Run episodes, numbered from `first`, with the map after a number of queries; return their number.

    Each is saved when it is over, and the next call runs only the missing ones.
    """
    path = files.episodes(after, first)
    done = {result.query for result in read_queries(path)}
    for number, episode in enumerate(episodes, first):
        if number not in done:
            run = cached_runner(plan, files, after).run
            result = _timed(partial(run, number, episode, episode_rng(plan.seed, number)))
            append_rows(path, plan.columns, [replace(result, after=after)])
    return len(episodes)


def _timed(run: Callable[[], QueryResult]) -> QueryResult:
    started = time.monotonic()
    return replace(run(), seconds=round(time.monotonic() - started, 3))


def record_failures(plan: RunPlan, files: RunFiles, run: Run, count: int) -> int:
    """Record the first failed episodes of a static test; return the number of recordings.

    Raises RecordingError if an episode differs from its first run.
    """
    (trial,) = run.maps
    failed = [episode.query for episode in trial.episodes if not episode.reached][:count]
    missing = [number for number in failed if not files.failure(number).exists()]
    if missing:
        runner = open_runner(plan, files, trial.after)
        drawn = prepare(plan, files).episodes(max(missing) + 1, plan.seed)
        for number in missing:
            _record(plan, files, runner, trial, drawn[number], number)
    return len(failed)


def _record(
    plan: RunPlan,
    files: RunFiles,
    runner: EpisodeRunner,
    trial: TestedMap,
    episode: EpisodePlan,
    number: int,
) -> None:
    system = runner.map.system
    settings = {"verb": "evaluate", "system": system.name, "episode": number, "seed": plan.seed}
    settings["method"] = asdict(system.method)
    described = RunDescription(
        scene=runner.scene.address,
        config=settings,
        fingerprint=runner.map.predictor.fingerprint,
        scene_glb=runner.scene.glb(),
    )
    with atomic_output(files.failure(number)) as part, described.open_writer(part) as writer:
        writer.write_map(runner.map.graph, runner.map.images)

        def write(event: Event, robot: SimulatedRobot) -> None:
            state = robot.state()
            writer.write_event(StampedEvent(state.step, state.stamp, event))

        again = runner.run(
            number,
            episode,
            episode_rng(plan.seed, number),
            on_event=write,
            wrap_robot=lambda robot: RecordedRobot(robot, writer),
        )
        before = trial.episodes[number]
        if (again.steps, again.outcome) != (before.steps, before.outcome):
            raise RecordingError(
                f"Episode {number} of {files.folder} took {again.steps} steps ({again.outcome}) when it was recorded, "
                f"and {before.steps} ({before.outcome}) before. The results were made by another version; evaluate "
                "anew."
            )
