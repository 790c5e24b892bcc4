"""Recordings of episodes that failed: each is driven once more, exactly as before, with everything written down.

Owns these recordings. They begin with the map, so they stand alone in `ltvn replay`.
"""

from dataclasses import asdict

from ltvn_core.errors import RecordingError
from ltvn_core.evaluate.course import Course
from ltvn_core.evaluate.plans import TrialFiles, TrialPlan
from ltvn_core.evaluate.preparation import prepare
from ltvn_core.evaluate.protocol import EpisodePlan
from ltvn_core.evaluate.results import TrialResult
from ltvn_core.evaluate.trials import episode_dice, open_course
from ltvn_core.nav.events import Event, Stamped
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.whole import written_whole
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.sim.robot import SimulatedRobot


def record_failures(plan: TrialPlan, files: TrialFiles, trial: TrialResult, count: int) -> int:
    """Record the first few failed episodes of a trial; return how many recordings there are.

    Raises RecordingError where an episode did not go as it went before.
    """
    failed = [episode.episode for episode in trial.episodes if not episode.reached][:count]
    missing = [number for number in failed if not files.failure(number).exists()]
    if missing:
        course, drawn = (
            open_course(plan, files, trial.queries),
            prepare(plan, files).episodes(max(missing) + 1, plan.seed),
        )
        for number in missing:
            _record(plan, files, course, trial, drawn[number], number)
    return len(failed)


def _record(
    plan: TrialPlan, files: TrialFiles, course: Course, trial: TrialResult, episode: EpisodePlan, number: int
) -> None:
    system = course.system
    settings = {"verb": "evaluate", "system": system.name, "episode": number, "seed": plan.seed}
    settings["method"] = asdict(system.method)
    about = {"scene": course.scene.address, "config": settings, "fingerprint": course.fingerprint}
    with written_whole(files.failure(number)) as part, RecordingWriter(part, **about) as writer:
        writer.map(course.graph, [course.views.observation(frame) for frame in course.views.frames])

        def write(event: Event, robot: SimulatedRobot) -> None:
            state = robot.state()
            writer.event(Stamped(state.step, state.stamp, event))

        again = course.run(
            number,
            episode,
            episode_dice(plan.seed, number),
            watch=write,
            through=lambda robot: RecordedRobot(robot, writer),
        )
        before = trial.episodes[number]
        if (again.steps, again.outcome) != (before.steps, before.outcome):
            raise RecordingError(
                f"Episode {number} of {files.folder} took {again.steps} steps ({again.outcome}) when it was recorded, "
                f"and {before.steps} ({before.outcome}) before. The results were made by another version; evaluate "
                "anew."
            )
