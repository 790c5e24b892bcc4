"""Runs plans: prepares their maps, drives the queries and episodes of their schedules, and reads the results.

A job is a batch of episodes with one map, a stretch of queries that change a map, or the line about a map. Results are
lines in files (see `results`), so an interrupted evaluation continues with the queries that have no line, on all
machines that share the folder, and progress is what lies in the folder. Random generators, frame numbers and the world
depend only on the number of the query, so interruptions do not change results.

Failed episodes can be repeated exactly and recorded; such a recording begins with the map, so `ltvn replay` needs no
other file.
"""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from joblib import delayed

from ltvn_core.atomic_files import atomic_output, atomic_replacement, write_text_atomically
from ltvn_core.data.recording.recorded_run import RecordedRobot, RunDescription
from ltvn_core.errors import RecordingError
from ltvn_core.evaluation.episode_runner import EpisodeRunner, cached_runner, episode_rng, open_runner
from ltvn_core.evaluation.ground_truth import calibration_bins, floorplan, map_truth_metrics
from ltvn_core.evaluation.lifelong_drive import LifelongDrive
from ltvn_core.evaluation.map_drawing import save_drawing
from ltvn_core.evaluation.plans import RunFiles, RunPlan, claim_files
from ltvn_core.evaluation.preparation import prepare
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
from ltvn_core.evaluation.worlds.world_drive import WorldDrive
from ltvn_core.evaluation.worlds.world_schedule import WorldSchedule, draw_world_schedule
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.fine_tuning_data import SystemTraining

BATCH_SIZE = 25
"""Number of queries or episodes in a batch. Small, so that an interruption loses few and all cores finish at nearly the
same time; large enough that maps are rarely loaded."""
_TOLD_EVERY_S = 0.5

_Batches: TypeAlias = list[tuple[int, int]]
"""Numbers of the first query or episode of each batch, and the numbers after its last."""


def batch_ranges(first: int, until: int) -> _Batches:
    """Return the number of the first query or episode of each batch, and the number after its last."""
    return [(begin, min(begin + BATCH_SIZE, until)) for begin in range(first, until, BATCH_SIZE)]


class Progress(NamedTuple):
    """What a share of the work has in its folder: drives, weights and maps, and lines about queries and episodes."""

    drives: int
    weights: int
    maps: int
    all_maps: int
    rows: int
    all_rows: int


def run_plans(
    plans: Sequence[RunPlan],
    folder: Path,
    *,
    command: str,
    parallel: Workers,
    tell: Callable[[Progress], object] = lambda _: None,
    part: Part = WHOLE,
    record: int = 0,
) -> list[Run]:
    """Run all queries and episodes of some plans that have no result yet.

    A `part` runs its share: single batches of plans without maintenance, others as a whole, because their queries
    follow each other. Returns the finished runs, including the work of other parts; if all are finished, first records
    the first `record` failures of each. `tell` is called repeatedly, from a thread. Raises OptionError if the folder
    has results with other settings, and WorldError if a changing world is impossible in its scene.
    """
    share: dict[RunFiles, _Batches] = {}
    for files, batches in part.of([(RunFiles.of(plan, folder), each) for plan in plans for each in _units(plan)]):
        share.setdefault(files, []).extend(batches)
    with _watched(share, tell):
        _prepare_all(list(share), parallel)
        for after in sorted({after for files in share for after in files.plan.schedule.tests or (0,)}):
            for _ in parallel(_jobs(share, after, command)):
                pass
    runs = [run for plan in plans if (run := finished_run(plan, folder)) is not None]
    if record and len(runs) == len(plans):
        again = zip(plans, runs, strict=True)
        list(parallel(delayed(record_failures)(RunFiles.of(plan, folder), run, record) for plan, run in again))
    return runs


def _units(plan: RunPlan) -> list[_Batches]:
    batches = batch_ranges(0, plan.protocol.episodes)
    return [batches] if plan.schedule.queries else [[batch] for batch in batches]


def _jobs(share: Mapping[RunFiles, _Batches], after: int, command: str) -> Iterator[Any]:
    """Yield the calls for the maps after a number of queries: the queries that follow, line, and static test."""
    for files in share:  # Stretches come first, because they take long and cannot run in parallel.
        stretches = (ends for ends in files.plan.schedule.stretches if ends[0] == after)
        yield from (delayed(run_stretch)(files, *ends) for ends in stretches)
    for files, batches in share.items():
        tests = files.plan.schedule.tests
        if after in (tests or (0,)) and not files.map_row(after).exists():
            yield delayed(describe_map)(files, after, command)
        if after in tests:
            yield from (delayed(run_episodes)(files, after, *batch) for batch in batches)


@contextmanager
def _watched(share: Mapping[RunFiles, _Batches], tell: Callable[[Progress], object]) -> Iterator[None]:
    """Tell the progress of a share repeatedly, from a thread, and once more when the block ends."""
    missing = {path: size for files, batches in share.items() for path, size in _files_of_rows(files, batches)}
    all_rows = sum(missing.values())
    over = threading.Event()

    def watch() -> None:
        unfinished = 0
        for path, size in list(missing.items()):
            found = path.read_bytes().count(b"\n") if path.exists() else 0
            if found >= size:
                del missing[path]  # So that it is not read again.
            unfinished += min(found, size) if found < size else 0
        done = all_rows - sum(missing.values()) + unfinished
        made = [(files.drive_truth.exists(), files.weights.exists(), files.map().exists()) for files in share]
        drives, weights, maps = map(sum, zip(*made, strict=True)) if made else (0, 0, 0)
        tell(Progress(drives, weights, maps, len(made), done, all_rows))

    def watch_on() -> None:
        watch()
        while not over.wait(_TOLD_EVERY_S):
            watch()

    thread = threading.Thread(target=watch_on, name="evaluation progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        watch()


def _files_of_rows(files: RunFiles, batches: _Batches) -> Iterator[tuple[Path, int]]:
    """Yield the path of each file of lines, and its number of queries or episodes."""
    for after in files.plan.schedule.tests:
        yield from ((files.episodes(after, first), until - first) for first, until in batches)
    for ends in files.plan.schedule.stretches:
        yield from ((files.query_batch(first, until), until - first) for first, until in batch_ranges(*ends))


def finished_run(plan: RunPlan, folder: Path) -> Run | None:
    """Read the results of a plan; None if some are missing."""
    run = next(iter(read_runs(sorted(RunFiles.of(plan, folder).run.glob(ROWS)))), None)
    schedule = plan.schedule
    tests = {known.after: known for known in run.maps} if run else {}
    if run is None or len(run.queries) < schedule.queries or not tests.keys() >= {0, *schedule.tests}:
        return None
    count = plan.protocol.episodes if schedule.tests else 0
    maps = [replace(tests[at], episodes=tests[at].episodes[:count]) for at in schedule.tests or (0,)]
    if any([each.query for each in known.episodes] != list(range(count)) for known in maps):
        return None
    return replace(run, maps=tuple(maps), queries=run.queries[: schedule.queries])


def _prepare_all(share: Sequence[RunFiles], parallel: Workers) -> None:
    """Create drives, weights, maps and the queries of changing worlds in parallel."""
    for files in share:
        claim_files(files)
    for system in {each.plan.system for each in share if each.plan.finetuned and not each.weights.exists()}:
        SystemTraining(system_entry(system).learning).rehearsal().prepare()  # Prepared once for all processes.
    for _ in parallel(delayed(prepare)(files) for files in share):
        pass
    in_worlds = {files.world_queries: files for files in share if files.plan.schedule.world}
    list(parallel(delayed(draw_world_schedule)(files) for files in in_worlds.values()))


def describe_map(files: RunFiles, after: int, command: str) -> None:
    """Write the line about a map and its drawing."""
    plan = files.plan
    truth = prepare(files)
    runner = cached_runner(files, after)
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
        calibration=calibration_bins(graph, runner.truth) if plan.schedule.stretches and not world else (),
        doors=load_results(files.world_queries, WorldSchedule).doors if world else (),
        version=version("ltvn"),
        command=command,
    )
    with atomic_replacement(files.map_row(after)) as new:  # Parts on other machines write the same line.
        new.write_text(f"{columns_line(line.columns, line)}\n", encoding="utf-8")


def run_stretch(files: RunFiles, first: int, until: int) -> None:
    """Drive the queries from `first` up to `until` in batches."""
    for begin, end in batch_ranges(first, until):
        run_query_batch(files, begin, end)


def run_query_batch(files: RunFiles, first: int, until: int) -> None:
    """Drive a batch of queries, starting with the map after `first` queries, in the world of the plan.

    Writes the map and the results; does nothing if both files exist.
    """
    rows, after = files.query_batch(first, until), files.map(until)
    if rows.exists() and after.exists():
        return
    plan = files.plan
    drive = WorldDrive(files, first) if plan.schedule.world else LifelongDrive(files, first)
    results = [_timed(partial(drive.run, query)) for query in range(first, until)]
    if not after.exists():
        world = {"world": plan.schedule.world, "maintenance": plan.maintenance} if plan.schedule.world else {}
        settings = {"verb": "lifelong", "seed": plan.seed, **world, "queries": until}
        drive.runner.map.save(after, config=settings, origin=files.map(first))
    if not rows.exists():
        if isinstance(drive, LifelongDrive):
            results = drive.check(results)
        write_text_atomically(rows, "".join(f"{columns_line(plan.columns, result)}\n" for result in results))


def run_episodes(files: RunFiles, after: int, first: int, until: int) -> None:
    """Run the episodes from `first` up to `until` with the map after a number of queries.

    Each is saved when it is over, and the next call runs only the missing ones.
    """
    plan, path = files.plan, files.episodes(after, first)
    done = {result.query for result in read_queries(path)}
    drawn = prepare(files).episodes(until, plan.seed)
    for number in range(first, until):
        if number not in done:
            run = cached_runner(files, after).run
            result = _timed(partial(run, number, drawn[number], episode_rng(plan.seed, number)))
            append_rows(path, plan.columns, [replace(result, after=after)])


def _timed(run: Callable[[], QueryResult]) -> QueryResult:
    started = time.monotonic()
    return replace(run(), seconds=round(time.monotonic() - started, 3))


def record_failures(files: RunFiles, run: Run, count: int) -> int:
    """Record the first failed episodes of a static test; return the number of recordings.

    Raises RecordingError if an episode differs from its first run.
    """
    (trial,) = run.maps
    failed = [episode.query for episode in trial.episodes if not episode.reached][:count]
    missing = [number for number in failed if not files.failure(number).exists()]
    if missing:
        runner = open_runner(files, trial.after)
        drawn = prepare(files).episodes(max(missing) + 1, files.plan.seed)
        for number in missing:
            _record(files, runner, trial, drawn[number], number)
    return len(failed)


def _record(
    files: RunFiles,
    runner: EpisodeRunner,
    trial: TestedMap,
    episode: EpisodePlan,
    number: int,
) -> None:
    system = runner.map.system
    settings = {"verb": "evaluate", "system": system.name, "episode": number, "seed": files.plan.seed}
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
            episode_rng(files.plan.seed, number),
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
