"""Records failed episodes by driving them once more, exactly as before.

A recording begins with the map, so `ltvn replay` needs no other file.
"""

from dataclasses import asdict

from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import RecordingError
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.results import TrialResult
from ltvn_core.evaluation.segments import episode_rng, open_runner
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.navigation.events import Event, StampedEvent
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.simulation.simulated_robot import SimulatedRobot


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
