"""`ltvn evaluate`: the paper's protocol, for LTVN and its rivals."""

import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from joblib import delayed
from tqdm import tqdm

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.metrics import compute_metrics
from ltvn_core.evaluation.perturbations import chosen_perturbations
from ltvn_core.evaluation.protocol import EvaluationProtocol, protocol_under
from ltvn_core.evaluation.results import TrialResult
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan, sole_evaluation
from ltvn_core.evaluation.trials import episodes_to_run, record_failures, run_trials
from ltvn_core.evaluation.workers import Part, workers
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.scene_registry import check_scene
from ltvn_core.verbs.evaluate import EvaluateVerb, ProtocolOptions
from ltvn_core.verbs.jobs.evaluation_progress import PartSummary, progress_on_bar


@dataclass(frozen=True)
class EvaluateSummary:
    """Results of the episodes of all scenes and seeds."""

    scenes: tuple[str, ...]
    method: str
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    episodes: int
    """Number of episodes of all scenes and seeds."""
    success_rate: float
    success_low: float
    """Lower limit of the 95 % confidence interval of the success rate."""
    success_high: float
    spl: float
    """Success weighted by path length."""
    collisions_per_episode: float
    steps_per_episode: float
    """Mean number of control steps of 0.1 s."""
    nodes: float
    """Mean number of nodes over the maps."""
    edges: float
    spurious_edges: float
    """Mean number of false edges, by the simulator's ground truth."""
    failures: dict[str, int]
    """Number of failed episodes by cause."""
    images_without_depth: int
    """Number of images of all mapping drives in which the camera found no depth; the maps are built without them."""
    folder: Path
    """Folder of drives, weights, maps and results; a second call of the verb continues from them."""
    wall_s: float


def _protocol(options: ProtocolOptions, episodes: int) -> EvaluationProtocol:
    """Return the settings of the test. Raises OptionError."""
    # The body is chosen here and not by the workers, which may be machines with other libraries.
    body = choose_body(options.body)
    plain = EvaluationProtocol(options.loops, options.goals, episodes, step_limit=options.step_limit, body=body)
    return protocol_under(plain, options.conditions)


def trial_plans(
    options: ProtocolOptions, system: str, episodes: int, perturbations: tuple[str, ...] = ()
) -> list[TrialPlan]:
    """Return a plan for each scene and seed. Raises OptionError and SceneError."""
    if (
        not options.scene
        or not options.seed
        or len({*options.scene}) < len(options.scene)
        or len({*options.seed}) < len(options.seed)
    ):
        raise OptionError("--scene and --seed need at least one value, and no value twice.")
    for scene in options.scene:
        check_scene(scene)  # Check all scenes before weights are fine-tuned for one of them.
    protocol = _protocol(options, episodes)
    predictor = ImageSource(camera=LOCOBOT.camera).choose(options.predictor).name
    return [
        TrialPlan(
            scene=scene,
            seed=seed,
            system=system,
            preset=options.preset,
            parts_off=tuple(sorted(options.without)),
            perturbations=perturbations,
            conditions=tuple(sorted(set(options.conditions))),
            predictor=predictor,
            weights=options.weights,
            finetune_steps=options.finetune_steps,
            protocol=protocol,
        )
        for scene in options.scene
        for seed in options.seed
    ]


def evaluate(options: EvaluateVerb) -> EvaluateSummary | PartSummary:
    """Run all episodes that have no result yet. Raises OptionError, SceneError, WeightsError, MapError and
    RecordingError."""
    if options.record_failures < 0:
        raise OptionError(f"--record-failures must be 0 or more, got {options.record_failures}.")
    started = time.monotonic()
    part = Part.parse(options.part)
    plans = trial_plans(options, options.system, options.episodes, chosen_perturbations(options.perturb))
    with (
        sole_evaluation(((plan, part.label) for plan in plans), options.folder),
        workers(options.processes, options.cluster, options.folder) as parallel,
        tqdm(total=episodes_to_run(plans, options.episodes, part), desc="evaluate", unit="episode") as bar,
    ):
        trials = run_trials(
            plans,
            options.folder,
            episodes=options.episodes,
            command=command(),
            parallel=parallel,
            progress=progress_on_bar(bar, len(plans)),
            part=part,
        )
        if len(trials) < len(plans):
            return PartSummary(str(part), bar.n, len(plans), len(trials), options.folder, time.monotonic() - started)
        if options.record_failures:
            jobs = [(plan, TrialFiles.of(plan, options.folder)) for plan in plans]
            again = zip(jobs, trials, strict=True)
            list(parallel(delayed(record_failures)(*job, trial, options.record_failures) for job, trial in again))
    return _summary(options, trials, time.monotonic() - started)


def _summary(options: EvaluateVerb, trials: Sequence[TrialResult], wall_s: float) -> EvaluateSummary:
    found = compute_metrics(trials)
    return EvaluateSummary(
        scenes=options.scene,
        method=options.system,
        preset=options.preset,
        without=options.without,
        seeds=options.seed,
        episodes=found.episodes,
        success_rate=found.success_rate.mean,
        success_low=found.success_rate.low,
        success_high=found.success_rate.high,
        spl=found.spl.mean,
        collisions_per_episode=found.collisions_per_episode.mean,
        steps_per_episode=found.steps_per_episode.mean,
        nodes=found.nodes,
        edges=found.edges,
        spurious_edges=found.spurious_edges,
        failures=found.failures,
        images_without_depth=sum(trial.without_depth for trial in trials),
        folder=options.folder,
        wall_s=wall_s,
    )


def command() -> str:
    """Return the current command line, with file names instead of absolute paths, because results are published."""
    return shlex.join(["ltvn", *map(_without_folders, sys.argv[1:])])


def _without_folders(argument: str) -> str:
    option, assigned, value = argument.rpartition("=")
    return f"{option}{assigned}{Path(value).name}" if Path(value).is_absolute() else argument
