"""The lifelong evaluation in a changing world: the same queries for each maintenance, side by side.

The queries of one map run one after the other; those of different maps and maintenances run in parallel.
"""

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from joblib import delayed

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.gzipped_results import is_stored
from ltvn_core.evaluation.parts import WHOLE, Part
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress
from ltvn_core.evaluation.results import WorldResult, load_results, save_results
from ltvn_core.evaluation.segments import Queries, ScheduledTest, load_batches, run_segments
from ltvn_core.evaluation.trial_plans import TrialFiles, claim_settings, plan_settings
from ltvn_core.evaluation.trials import prepare_all
from ltvn_core.evaluation.workers import Workers
from ltvn_core.evaluation.worlds.schedule import Schedule, draw_schedule
from ltvn_core.evaluation.worlds.world_drive import WorldDrive
from ltvn_core.evaluation.worlds.world_plans import WorldFiles, WorldPlan
from ltvn_core.recording.map_file import load_map
from ltvn_core.simulation.scene_registry import load_scene


def run_world_evaluation(
    plans: Sequence[WorldPlan],
    folder: Path,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[WorldResult]:
    """Run the evaluation of several plans; existing results are only read.

    A `part` runs its share of the plans, and returns the results of all that are done by then, whoever ran them. Raises
    OptionError if the folder has results of other settings, and WorldError where the scene cannot change so.
    """
    mine = part.of(plans)
    files_of = dict(prepare_all(list(dict.fromkeys(plan.trial for plan in mine)), folder, parallel, progress))
    jobs = [(plan, WorldFiles.of(plan, files_of[plan.trial])) for plan in mine]
    for plan, files in jobs:
        claim_settings(files.settings, _settings(plan))
    first = {files.schedule: (plan, files) for plan, files in jobs}
    list(parallel(delayed(_schedule)(*job) for job in first.values()))
    run_segments([_scheduled(plan, files) for plan, files in jobs], parallel, progress)
    for plan, files in jobs:
        _finish(plan, files, command)
    results = (WorldFiles.of(plan, TrialFiles.of(plan.trial, folder)).result for plan in plans)
    return [load_results(result, WorldResult) for result in results if is_stored(result)]


def _settings(plan: WorldPlan) -> dict[str, Any]:
    """Return what script and queries were made with; all maintenances have the same."""
    file = Path(plan.world)
    script = file.read_text(encoding="utf-8") if file.is_file() else plan.world
    shared = {"trial": plan_settings(plan.trial), "maintenance": "any", "script": script, "version": version("ltvn")}
    return asdict(plan) | shared


def _schedule(plan: WorldPlan, files: WorldFiles) -> None:
    """Draw the queries, unless that is done."""
    if files.schedule.exists():
        return
    scene, loaded = load_scene(plan.trial.scene), load_map(files.map(0))
    truth = GroundTruth(scene.clearance, loaded.observations.__getitem__)
    drive_truth = prepare(plan.trial, files.trial)
    save_results(files.schedule, draw_schedule(plan, scene, loaded.graph, truth, drive_truth))


def _scheduled(plan: WorldPlan, files: WorldFiles) -> ScheduledTest:
    """Return the test of a plan: queries alone."""
    return ScheduledTest(
        plan.trial, files.trial, (Queries(0, plan.queries),), partial(WorldDrive, plan, files), query_files=files
    )


def _finish(plan: WorldPlan, files: WorldFiles, command: str) -> None:
    """Combine the batches and save the result."""
    if is_stored(files.result):
        return
    schedule: Schedule = load_results(files.schedule, Schedule)
    batches = load_batches(files, 0, plan.queries)
    result = WorldResult(
        scene=load_scene(plan.trial.scene).name,
        preset=plan.trial.preset,
        without=plan.trial.parts_off,
        seed=plan.trial.seed,
        world=plan.world,
        days=plan.days,
        maintenance=plan.maintenance,
        nodes=schedule.nodes,
        edges=schedule.all_edges,
        true_edges=len(schedule.edges),
        doors=schedule.doors,
        queries=tuple(query for batch in batches for query in batch.queries),
        wall_s=sum(batch.wall_s for batch in batches),
        version=version("ltvn"),
        command=command,
    )
    save_results(files.result, result)
