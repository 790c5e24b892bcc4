"""Runs trials (many episodes with one map each), in parallel on any number of processes or machines.

Failed episodes can be repeated exactly and recorded; such a recording begins with the map, so `ltvn replay` needs no
other file.
"""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from joblib import delayed

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.recording.recorded_run import RecordedRobot, RunDescription
from ltvn_core.errors import RecordingError
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.ground_truth import floorplan, map_truth_metrics
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress, read_share, told_repeatedly
from ltvn_core.evaluation.protocol import EpisodePlan, told_conditions
from ltvn_core.evaluation.query_result import QueryBatch
from ltvn_core.evaluation.results import TrialResult, is_stored, load_results, save_drawing, save_results
from ltvn_core.evaluation.segments import (
    Episodes,
    ScheduledTest,
    batch_ranges,
    cached_runner,
    episode_rng,
    open_runner,
    run_segments,
)
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan, claim_files
from ltvn_core.evaluation.workers import WHOLE, Part, Workers
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.fine_tuning_data import system_training


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

    A `part` runs its share of the episodes. Returns the results of all plans that are finished, including the work of
    other parts. Raises OptionError if the folder has results with other settings.
    """
    mine = _share(plans, episodes, part)
    jobs = prepare_all(list(dict.fromkeys(plan for plan, _ in mine)), folder, parallel, progress)
    run_segments([_static_test(plan, files, episodes, mine) for plan, files in jobs], parallel, progress)
    # Read from files, because batches finish in any order, and other parts may have run some.
    whole = [(plan, files) for plan, files in _all_files(plans, folder) if _is_complete(files, episodes)]
    list(parallel(delayed(_finish)(plan, files, episodes, command) for plan, files in whole))
    return [load_results(files.trial(episodes), TrialResult) for _, files in whole]


def _static_test(
    plan: TrialPlan, files: TrialFiles, episodes: int, mine: Sequence[tuple[TrialPlan, tuple[int, int]]]
) -> ScheduledTest:
    """Return the static test of a plan with those of its batches that are in `mine`."""
    batches = tuple(batch for each, batch in mine if each == plan)
    return ScheduledTest(plan, files, (Episodes(0, episodes, batches),))


def episodes_to_run(plans: Sequence[TrialPlan], episodes: int, part: Part) -> int:
    """Return the number of episodes in a part of the static tests of some plans."""
    return sum(until - first for _, (first, until) in _share(plans, episodes, part))


def _share(plans: Sequence[TrialPlan], episodes: int, part: Part) -> list[tuple[TrialPlan, tuple[int, int]]]:
    """Return the batches of a part."""
    return part.of([(plan, batch) for plan in plans for batch in batch_ranges(0, episodes)])


def _all_files(plans: Sequence[TrialPlan], folder: Path) -> list[tuple[TrialPlan, TrialFiles]]:
    return [(plan, TrialFiles.of(plan, folder)) for plan in plans]


def _is_complete(files: TrialFiles, episodes: int) -> bool:
    """Tell whether all episodes of a static test are finished, by this command or by others."""
    batches = (files.episodes(0, first, until) for first, until in batch_ranges(0, episodes))
    return is_stored(files.trial(episodes)) or (files.map().exists() and all(batch.exists() for batch in batches))


def prepare_all(
    plans: Sequence[TrialPlan], folder: Path, parallel: Workers, progress: EvaluationProgress
) -> list[tuple[TrialPlan, TrialFiles]]:
    """Create drives, weights and maps in parallel; raises the same errors as `run_trials`."""
    jobs = _all_files(plans, folder)
    for plan, files in jobs:
        claim_files(plan, files)
    without_data: set[str] = {plan.system for plan, files in jobs if plan.finetuned and not files.weights.exists()}
    for system in without_data:
        system_training(system_entry(system)).rehearsal().prepare()  # Prepared once for all processes.
    with told_repeatedly(lambda: progress.preparing(sum(_share_prepared(files) for _, files in jobs) / len(jobs))):
        for ready, _ in enumerate(parallel(delayed(prepare)(plan, files) for plan, files in jobs), 1):
            progress.maps_ready(ready)
    return jobs


def _share_prepared(files: TrialFiles) -> float:
    share = read_share(files.preparation)  # Read first, because the file disappears once the map is there.
    return 1.0 if files.map().exists() else share


def _finish(plan: TrialPlan, files: TrialFiles, episodes: int, command: str) -> None:
    """Save the result of the static test."""
    if not is_stored(files.trial(episodes)):
        keep_drawing(plan, files, 0)
        save_results(files.trial(episodes), finish_trial(plan, files, 0, episodes, command))


def keep_drawing(plan: TrialPlan, files: TrialFiles, queries: int) -> None:
    """Draw the map after a number of queries, unless the drawing exists."""
    if not files.drawing(queries).exists():
        runner = cached_runner(plan, files, queries)
        save_drawing(files.drawing(queries), floorplan(runner.map.graph, runner.truth))


def finish_trial(plan: TrialPlan, files: TrialFiles, queries: int, episodes: int, command: str) -> TrialResult:
    """Combine the batches, and add the metrics of the map."""
    paths = [files.episodes(queries, first, until) for first, until in batch_ranges(0, episodes)]
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
        fingerprint=runner.map.predictor.fingerprint,
        map=map_truth_metrics(runner.map.graph, runner.truth, drive_truth.goals),
        floorplan=None,
        episodes=tuple(episode for batch in batches for episode in batch.queries),
        wall_s=sum(batch.wall_s for batch in batches),
        version=version("ltvn"),
        command=command,
        without_depth=drive_truth.without_depth,
        perturbations=plan.perturbations,
        conditions=told_conditions(plan.protocol, plan.conditions),
    )


def record_failures(plan: TrialPlan, files: TrialFiles, trial: TrialResult, count: int) -> int:
    """Record the first failed episodes of a trial; return the number of recordings.

    Raises RecordingError if an episode differs from its first run.
    """
    failed = [episode.query for episode in trial.episodes if not episode.reached][:count]
    missing = [number for number in failed if not files.failure(number).exists()]
    if missing:
        runner = open_runner(plan, files, trial.queries)
        drawn = prepare(plan, files).episodes(max(missing) + 1, plan.seed)
        for number in missing:
            _record(plan, files, runner, trial, drawn[number], number)
    return len(failed)


def _record(
    plan: TrialPlan, files: TrialFiles, runner: EpisodeRunner, trial: TrialResult, episode: EpisodePlan, number: int
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
